// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The questions of the concept, asked of a machine of any family.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "polypod/kinematics/concept.hpp"
#include "polypod/kinematics/hexapod_modes.hpp"
#include "polypod/machine/any_machine.hpp"

namespace polypod::kinematics {

using machine::AnyMachine;

int joint_count(const AnyMachine& machine);
JointKind joint_kind(const AnyMachine& machine, int joint);
machine::JointRange joint_range(const AnyMachine& machine, int joint);
Task task(const AnyMachine& machine);
/// One chain from base to tool; all others are parallel.
inline bool is_serial(const AnyMachine& machine) {
  return std::holds_alternative<machine::SerialArm>(machine);
}
/// 6, 5 or 3 for a task of pose, axis or point, or the number of joints if that is less.
int degrees_of_freedom(const AnyMachine& machine);
std::vector<Parameter> parameters(const AnyMachine& machine);
std::string limit_name(const AnyMachine& machine, int limit);
/// The names of the set bits.
std::vector<std::string> limit_names(const AnyMachine& machine, LimitBits bits);

/// Poses of the joints q, best first.
struct ForwardResult {
  std::vector<Pose> poses;
  std::vector<double> residuals;  ///< largest |F_i| of each, m (or the closure's unit)
  bool complete = true;           ///< the list is proven to hold every real solution
  std::string reason;             ///< why there is no pose, where there is none
};
/// The pose of the joints q; for a parallel machine the mode that is reached from home, and not complete. Where there
/// is none, `reason` says whether the legs meet at no real pose (proven, or not found) or Newton's method failed.
ForwardResult forward(const AnyMachine& machine, const JointVector& q);
/// Why `forward` found no pose, as a person asks it: for hexapods all assembly modes are looked for (10 ms to some
/// seconds), to tell "there is none" from "none was found".
std::string why_no_pose(const AnyMachine& machine, const JointVector& q, const ForwardResult& result);
/// Every pose of the joints where a closed form has them all (deltas: both, the machine's first); otherwise `forward`.
ForwardResult forward_all(const AnyMachine& machine, const JointVector& q);
/// Gruebler's count, for the families that have one.
std::optional<machine::Mobility> mobility(const AnyMachine& machine);
/// Every assembly mode of a parallel machine on six legs (assembly_modes); nothing for other machines, whose pose is
/// the only one.
std::optional<machine::AssemblyModes> assembly_modes(const AnyMachine& machine, const JointVector& q);
/// The limits that the pose breaks with these joints; one that is missed by rounding alone (1e-10) is kept.
LimitBits violations(const AnyMachine& machine, const Pose& X_MT, const JointVector& q);
InverseResult inverse(const AnyMachine& machine, const Pose& X_MT);
/// The same on a way, after the joints `last`: the solution with the smallest largest change of a joint first, joints
/// that may turn more than once in the turn nearest to `last`. A numeric inverse searches from `last`, and from its
/// usual starts only where that finds nothing within the limits.
InverseResult inverse_near(const AnyMachine& machine, const Pose& X_MT, const JointVector& last);
/// Why an inverse gives nothing within the limits: its own reason, or the limits of the solution that breaks the
/// fewest.
std::string reason_of(const AnyMachine& machine, const InverseResult& result);
/// 6 x joints, twist in M per joint speed.
JacobianMatrix jacobian(const AnyMachine& machine, const Pose& X_MT, const JointVector& q);

/// A pose from what a person writes: x, y, z (m) and the angles of the task (A, B or A, B, C, rad).
Pose pose_of(Task task, const std::vector<double>& coordinates);
/// The same backwards: 6, 5 or 3 numbers.
std::vector<double> coordinates_of(Task task, const Pose& X);
inline int coordinate_count(Task task) {
  return task == Task::pose ? 6 : task == Task::axis ? 5 : 3;
}

/// The square part of a Jacobian that a task sees: rows v_x, v_y, v_z, w_x, w_y, w_z; without w_z for Task::axis
/// (SLAV (2.36)); the three of v for Task::point.
Eigen::MatrixXd task_jacobian(Task task, const JacobianMatrix& J);

/// How well joints and tool move each other at a pose. Lengths and angles have no common measure: angles count as
/// lengths on the characteristic length L.
struct Dexterity {
  double condition = 0;              ///< kappa = sigma_max / sigma_min of S, >= 1, infinite if singular
  double sigma_min = 0;              ///< the smallest singular value of S
  double determinant = 0;            ///< see below; 0 if S is not square
  double characteristic_length = 0;  ///< L, m
};
/// Parallel machines (JEL (6.5), (6.11)): S takes the tool's twist [v; L w] to joint speeds, its rows (w_i, e_i x w_i /
/// L), on rails divided by w_i . u_i; the determinant is |det S|. L: mean distance of the platform joints from the tool
/// tip. Where a slider's leg is square to its rail, S is infinite (kind 1).
/// Serial arms (SLAV (2.38)): S takes joint speeds to [v; L w] (rows that the task sees); the determinant is that of
/// the same matrix without L, SI. L: mean distance of the joint axes from the tool tip, 1 m if there are none.
/// A `length` above 0 replaces L. Cost: 2 us.
Dexterity dexterity(const AnyMachine& machine, const Pose& X_MT, const JointVector& q, double length = 0);

}  // namespace polypod::kinematics
