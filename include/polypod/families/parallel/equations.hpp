// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The closure of a machine of legs with its derivatives in closed form, and the coordinates that follow.
#pragma once

#include <optional>

#include "polypod/families/parallel/machine.hpp"

namespace polypod::machine {

/// Values and rows by the tool tip's twist [v; w] in M of some closure equations, all in metres (rotations count
/// Parallel::size metres a radian).
struct EquationRows {
  ClosureVector F;
  Eigen::Matrix<double, Eigen::Dynamic, 6, 0, kMaxEquations, 6> A;
};

/// Equations that hold whatever the drives do: passive rods and constraints.
EquationRows passive_rows(const Parallel& m, const Pose& X_MT);
/// All equations in the order of `closure`: legs, constraints, the kept angle C. With `B` (equations x drives) also the
/// derivative by the drives.
EquationRows closure_rows(
    const Parallel& m, const Pose& X_MT, const JointVector& q,
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxEquations, kMaxJoints>* B = nullptr);

/// Where the equations of constraints begin in them: kinematics::hold_constraints.
inline Eigen::Index first_constraint_row(const Parallel& m) {
  return static_cast<Eigen::Index>(m.legs.size());
}

/// Two unit vectors square to a unit vector and to each other; they change only with a large change of it.
std::array<Vec3, 2> across(const Vec3& axis);

/// The joint of a leg where its rod begins: the base joint, the slider or the end of the arm, in M.
Vec3 leg_anchor(const ParallelLeg& leg, double q);
/// Where the leg ends at a pose, in M; on a ring the point of the ring that its joint glides to.
Vec3 leg_end(const Parallel& m, const ParallelLeg& leg, const Pose& X_MT);

/// Both positions of a leg's drive at a pose (of a strut the same twice), and how far they are real: the part under the
/// root, m^2. Of a rail the smaller is `low`; of a crank `low` = phi - acos(..), phi the direction in which the
/// platform joint is seen. Angles are those next to the middle of the range.
struct LegRoots {
  double low = 0, high = 0, under = 0;
  [[nodiscard]] bool real() const { return under >= 0; }
};
LegRoots leg_roots(const Parallel& m, const ParallelLeg& leg, const Pose& X_MT);

/// The whole pose for what the task prescribes of `target`: Newton's method on passive rods and constraints, from the
/// other coordinates at home, in steps along the straight line of the task's coordinates where one step would be long,
/// so that the assembly mode is that of home. Empty where a step does not converge: the constraints cannot be met, or
/// are singular on the way. A target that keeps them already is returned as it is. Cost: 2 us a step.
std::optional<Pose> settled(const Parallel& m, const Pose& target);

}  // namespace polypod::machine
