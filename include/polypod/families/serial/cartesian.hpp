// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The closed inverse of gantries and other machines with three linear axes that carry a head of rotary axes.
#pragma once

#include <array>
#include <optional>

#include "polypod/families/serial/kinematics.hpp"

namespace polypod::machine {

/// Inverse kinematics of machines whose first three free joints are linear, in any three independent directions, and
/// carry two rotary joints (a pose prescribes the tool's axis: 5-axis heads, fork, nutating or offset) or three (a pose
/// prescribes all six coordinates). Any table, any locked joints, base and tool: the axes in the zero position count.
///
/// With the joints at 0, u, v (and w) the directions of the rotary axes, R_0 and p_0 the tool's, all in M:
/// - R R_0^T = R_u(q4) R_v(q5) R_w(q6), with the tool's axis for w where there are two rotary joints: a spherical
///   triangle, two solutions for q5 (six_joints.hpp: Turns);
/// - the rotary joints take the tip from p_0 to p(q4, q5, q6); then D (q1, q2, q3)^T = p_MT - p, with the linear axes
///   as columns of D.
///
/// Two branches, `tilt-positive` with q5 above and `tilt-negative` with q5 below the position in which the first rotary
/// axis and the last (or the tool) are nearest in line; of two such positions the one nearer to 0, as of a fork.
///
/// In line, q4 is free: it is that of the reference, or 0, and half a turn off in the other branch; where a limit stops
/// these, the nearest of 72 angles round a turn with which none does. This is no singular pose to a program that leaves
/// the tool there, as every three-axis program does, so it is not marked; `free_joints` names it,
/// and a path that leaves it in a direction for which q4 stands otherwise makes that joint jump. Marked singular is the
/// tool as far from in line as the head allows. No solution where the head cannot point the tool there, as of a
/// nutating head; linear axes have no ends but their limits.
class CartesianInverse {
 public:
  /// Nothing if the machine has no such form.
  static std::optional<CartesianInverse> of(const SerialArm& arm);

  /// Both branches of the pose X_MT with their limits. Rotary joints stand in the turn within their range if there is
  /// one, else in (-pi, pi]; with a `reference` (all joints): of several within the range in the nearest to it.
  [[nodiscard]] kinematics::InverseResult solve(const Pose& X_MT, const double* reference = nullptr) const;
  static const char* branch_name(unsigned branch) { return branch == 0 ? "tilt-positive" : "tilt-negative"; }

  /// What workspaces need of the table, in M at joints 0.
  struct Form {
    int joints;
    std::array<JointRange, 6> range;
    Vec3 u, v;        ///< of the first two rotary axes
    Vec3 k_T;         ///< in the tool frame: the direction that they point (the tool's axis, or the third rotary axis)
    Vec3 from_tip_T;  ///< in the tool frame, from the tip to the point that they carry: 0 of two rotary axes
    Vec3 carried;     ///< that point
    Vec3 point_u, point_v;  ///< of the axes: where they meet, if they do
    double middle;          ///< q5 where u and k are nearest to in line
    Vec3 k;                 ///< k_T in M
    Mat3 to_linear;         ///< D^-1
  };
  [[nodiscard]] Form form() const;

 private:
  /// The joints with these rotary angles, and what limits they keep.
  [[nodiscard]] kinematics::Solution with(const Pose& X_MT, std::array<double, 3> angle, const double* reference) const;

  int joints_ = 0;  ///< 5 or 6
  std::array<JointRange, 6> range_{};
  double straight_ = 0;        ///< q5 in line
  std::array<Vec3, 3> axis_;   ///< u, v, w in M
  std::array<Vec3, 3> point_;  ///< of each
  Pose X_0_;                   ///< X_MT at joints 0
  Mat3 to_linear_;             ///< D^-1
};

}  // namespace polypod::machine
