// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The questions of the concept, asked of a machine of any family.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "polypod/families/hexapod/modes.hpp"
#include "polypod/kinematics/concept.hpp"
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
/// Whether a pose counts as reached in any posture (chains), or in the machine's own alone (parallel machines).
bool takes_any_posture(const AnyMachine& machine);
/// The tool tip's pose at home, of machines that have one.
std::optional<Pose> home_pose(const AnyMachine& machine);
/// The number of coordinates of the task, or of joints if that is less.
int degrees_of_freedom(const AnyMachine& machine);
std::vector<Parameter> parameters(const AnyMachine& machine);
std::string limit_name(const AnyMachine& machine, int limit);
/// What each limit is, in the order of `limits`.
machine::LimitTable limit_table(const AnyMachine& machine);
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
/// Every pose of the joints where a closed form has them all (deltas: both, the machine's first); of machines of legs
/// those that a search from home and 2000 further starts finds; otherwise `forward`.
ForwardResult forward_all(const AnyMachine& machine, const JointVector& q);
/// Gruebler's count, for the families that have one.
std::optional<machine::Mobility> mobility(const AnyMachine& machine);
/// Every assembly mode of a parallel machine on six legs (assembly_modes); nothing for other machines, whose pose is
/// the only one.
std::optional<machine::AssemblyModes> assembly_modes(const AnyMachine& machine, const JointVector& q);
/// The limits that the pose breaks with these joints; one that is missed by rounding alone (1e-10) is kept.
LimitBits violations(const AnyMachine& machine, const Pose& X_MT, const JointVector& q);
/// All solutions of what the task prescribes of the pose, each branch once; whatever else X_MT holds is not looked at.
/// Of joints that may turn more than once, one turn is given, within the limits where one is (inverse_near finds the
/// others). X_MT.R must be a rotation, X_MT.p is in m. Solutions: up to 8 for arms, 1 for struts and for sliders with
/// their roots, 2 to the power of its cranks for deltas; none with a reason. At a singular pose two of them may be
/// equal.
InverseResult inverse(const AnyMachine& machine, const Pose& X_MT);
/// The same on a way, after the joints `last`: the solution with the smallest largest change of a joint first, joints
/// that may turn more than once in the turn nearest to `last`. A numeric inverse searches from `last`, and from its
/// usual starts only where that finds nothing within the limits.
InverseResult inverse_near(const AnyMachine& machine, const Pose& X_MT, const JointVector& last);
/// The whole pose that the machine really has where it takes the joints q for what the task prescribes of X_MT: the
/// coordinates that no pose prescribes follow (the turn of a 5-axis arm about its tool, the tool at zero tilt of a
/// delta, the parasitic motions of a tripod). Analyses ask for this before anything else.
Pose settled(const AnyMachine& machine, const Pose& X_MT, const JointVector& q);
/// Where the machine has it, the whole pose without known joints: empty where the following coordinates cannot be met.
std::optional<Pose> settled(const AnyMachine& machine, const Pose& X_MT);
/// What a solution's branch is called: "front elbow-up", "inner at 1, 3", "posture 2"; "only" where there is but one.
std::string branch_name(const AnyMachine& machine, unsigned branch);
/// Why an inverse gives nothing within the limits: its own reason, or the limits of the solution that breaks the
/// fewest.
std::string reason_of(const AnyMachine& machine, const InverseResult& result);
/// 6 x joints, twist in M per joint speed.
JacobianMatrix jacobian(const AnyMachine& machine, const Pose& X_MT, const JointVector& q);

/// A pose from what a person writes: the coordinates of the task in its order, m and rad; those that are missing, and
/// those that the task does not prescribe, are 0; more of them than the task has are not looked at.
Pose pose_of(Task task, const std::vector<double>& coordinates);
/// The same backwards: one number a coordinate of the task.
std::vector<double> coordinates_of(Task task, const Pose& X);
inline int coordinate_count(Task task) {
  return task.size();
}

/// The part of a Jacobian that a task sees: of the rows v_x, v_y, v_z, w_x, w_y, w_z those of its coordinates x, y, z,
/// A, B, C, in its order. Of a 5-axis machine, whose pose prescribes the tool's axis alone, the turns are those about x
/// and y of the tool's frame, X_MT.R^T w, across its axis; at zero tilt they are w_x and w_y (SLAV (2.36)).
Eigen::MatrixXd task_jacobian(Task task, const JacobianMatrix& J, const Pose& X_MT);

/// Whether the tool turns as it moves though the task prescribes no orientation: that of a Tricept follows from its
/// position, a delta keeps it. Judged at home.
bool orientation_follows(const AnyMachine& machine);

/// How well joints and tool move each other at a pose. Lengths and angles have no common measure: angles count as
/// lengths on the characteristic length L.
struct Dexterity {
  double condition = 0;              ///< kappa = sigma_max / sigma_min of S, >= 1, infinite if singular
  double sigma_min = 0;              ///< the smallest singular value of S
  double determinant = 0;            ///< see below; 0 if S is not square
  double characteristic_length = 0;  ///< L, m
};
/// Parallel machines (JEL (6.5), (6.11)): S takes the tool's twist [v; L w] to joint speeds, its rows (w_i, e_i x w_i /
/// L), of slider hexapods divided by w_i . u_i; the determinant is |det S|. L: mean distance of the platform joints
/// from the tool tip. Where a slider's leg is square to its rail, S is infinite (type 1).
/// Serial arms (SLAV (2.38)): S takes joint speeds to [v; L w] (rows that the task sees); the determinant is that of
/// the same matrix without L, SI. L: mean distance of the joint axes from the tool tip, 1 m if there are none.
/// A `length` above 0 replaces L. Cost: 0.4 us (deltas) to 2 us.
Dexterity dexterity(const AnyMachine& machine, const Pose& X_MT, const JointVector& q, double length = 0);

}  // namespace polypod::kinematics
