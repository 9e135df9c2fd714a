// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The closed inverse of industrial robots: six joints, the last three of which meet in one point.
#pragma once

#include <array>
#include <optional>

#include "polypod/families/serial/machine.hpp"
#include "polypod/kinematics/concept.hpp"

namespace polypod::machine {

/// Inverse kinematics of arms with six free turning joints whose axes 4, 5 and 6 meet in the wrist centre W, whose axes
/// 2 and 3 are parallel, and whose axis 1 is square to them (KUKA, ABB, Fanuc, Staubli: nearly all with six joints).
/// Any table, standard or modified, any senses and zeros: the axes of the arm in its zero position are all that counts.
///
/// With the product of exponentials X_MT = e_1 .. e_6 X_0 and T = X_MT X_0^-1 (Paden 1986, subproblems 1 to 3):
/// - e_1 .. e_3 W = T W; along axis 2 only e_1 moves W:  w_2 . e_1^-1 (T W - o_2) = w_2 . (W - o_2), two angles 1;
/// - |e_3 W - o_2| = |e_1^-1 T W - o_2|, two angles 3 (law of cosines), then angle 2;
/// - w_4 . R_5 w_6 = w_4 . R w_6 with R = (R_1 R_2 R_3)^T R_T, two angles 5, then angles 4 and 6.
/// Eight branches `front|back elbow-up|elbow-down [wrist-flipped]` in this order: front where the wrist centre lies on
/// the side of axis 1 on which axis 2 stands (axis 2 through axis 1: on which W stands at joints 0), elbow-up where the
/// elbow lies above the line from axis 2 to W, seen with the wrist to the right and axis 1 up (away from the base).
/// Singular and marked so: W on axis 1 (angle 1 taken as 0), axes 4 and 6 in line (angle 4 taken as 0). Cost: 1 us.
class SphericalWristInverse {
 public:
  /// Nothing if the arm has no such form.
  static std::optional<SphericalWristInverse> of(const SerialArm& arm);

  [[nodiscard]] kinematics::InverseResult solve(const Pose& X_MT) const;

 private:
  struct Joint {
    Vec3 axis, point;  ///< in M at joint values 0; positive turns of the joint are positive turns about the axis
    JointRange range;
  };
  void wrist(const Mat3& R, double q1, double q2, double q3, bool over_axis, unsigned branch,
             kinematics::InverseResult& out) const;

  std::array<Joint, 6> joints_;
  Pose X_0_inverse_;
  Vec3 wrist_;
  Vec3 front_, up_;  ///< square to axis 2: the arm's plane at angle 1 = 0
};

}  // namespace polypod::machine
