// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The closed inverse of arms with six joints, three of them parallel, as those of Universal Robots.
#pragma once

#include <array>
#include <optional>

#include "polypod/families/serial/spherical_wrist.hpp"

namespace polypod::machine {

/// Inverse kinematics of arms with six free turning joints whose axes 2, 3 and 4 are parallel, square to axis 1, and
/// whose axes 5 and 6 meet in a point P. Any table, as for SphericalWristInverse.
///
/// In the frame with z along axis 1 and y along axis 2:
/// - only joint 1 moves P across the arm's plane: P = Rz(t1) (rho, b, z), rho = +-sqrt(x^2 + y^2 - b^2);
/// - R_1^T R = R_y(joints 2 + 3 + 4) R_5 R_6: a spherical triangle, two solutions for joint 5;
/// - then the point of axis 4 is known, and two links reach it: two solutions for joint 3.
///
/// Eight branches `front|back elbow-up|elbow-down [wrist-flipped]` in the order of SphericalWristInverse: front where P
/// is on the side of axis 1 on which axis 2 stands (axis 2 through axis 1: on which P stands at joints 0); elbow-up
/// where the elbow lies above the line from axis 2 to axis 4, seen as there; flipped where joint 5 stands below the
/// position in which axes 4 and 6 are in line at joint value 0, else point the same way.
///
/// Singular, and marked so: axes 4 and 6 in line (joint 6 is that of the reference, or 0, or as
/// near to it as lets the links reach; joints 2 to 4 do the rest),
/// axis 4 on axis 2 (likewise joint 2), P on axis 1 (likewise joint 1), the arm stretched or folded, P as near to axis
/// 1 as b allows. Near these the pose follows from the joints to rounding.
class ThreeParallelInverse {
 public:
  using Branches = SixJointBranches;

  /// Nothing if the arm has no such form.
  static std::optional<ThreeParallelInverse> of(const SerialArm& arm);

  /// All branches of the pose X_MT, turns and reference as in SphericalWristInverse. No allocation.
  void solve(const Pose& X_MT, Branches& out, const double* reference = nullptr) const;
  /// The same with limits, as a list.
  [[nodiscard]] kinematics::InverseResult solve(const Pose& X_MT, const double* reference = nullptr) const;

  /// Two bits a joint, in the order of `limits`.
  [[nodiscard]] kinematics::LimitBits violations(const double* joints) const;

  /// What workspaces need of the table, all in the arm's frame A but what stands in the tool frame T.
  struct Form {
    std::array<JointRange, 6> range;
    double sense_3;  ///< of joint 3
    Mat3 R_AM;
    Vec3 p_AM;
    Vec3 P_T, w6_T;              ///< P, and the direction of axis 6
    std::array<double, 2> hand;  ///< P from axis 4 in the arm's plane (x, z), seen from the direction into which axis 6
                                 ///< leans out of axis 4
    double a1, b, upper, fore, bend;
  };
  /// Of a wrist whose axes 4, 5 and 6 are each square to the next; nothing of others.
  [[nodiscard]] std::optional<Form> form() const;

 private:
  std::array<JointRange, 6> range_;
  std::array<double, 4> sense_{};  ///< +1 or -1: of joint 1 against z, of joints 2 to 4 against the turn from x to z
  Mat3 R_AM_;                      ///< the arm's frame A: x to the front, z up along axis 1
  Vec3 p_AM_;
  Mat3 R_TA_;        ///< at joints 0
  Vec3 P_, fourth_;  ///< where axes 5 and 6 meet, and a point of axis 4, in A at joints 0
  Vec3 P_T_;         ///< P in the tool frame
  Vec3 w5_, w6_;     ///< in A, at joints 0
  double a1_ = 0, b_ = 0, upper_ = 0, fore_ = 0, bend_ = 0;
  double upper_c_ = 1, upper_s_ = 0;
  bool swapped_ = false;
};

}  // namespace polypod::machine
