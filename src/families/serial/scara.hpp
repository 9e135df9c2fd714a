// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The closed inverse of SCARA robots.
#pragma once

#include <array>
#include <optional>

#include "polypod/families/serial/kinematics.hpp"

namespace polypod::machine {

/// Inverse kinematics of arms with three turning joints and one slide, in any order, all along z of M, whose task is x,
/// y, z and C. Any table, senses, offsets, locked joints, base and tool.
///
/// In the plane, with the axes at o_1, o_2, o_3 and the tip at p_0 where the joints are 0, and phi = C - C_0: the third
/// axis must be at w = p - R(phi) (p_0 - o_3), which the links o_1 o_2 and o_2 o_3 reach with the elbow bent to either
/// side, cos(beta) = (|w - o_1|^2 - l_1^2 - l_2^2) / (2 l_1 l_2); theta_3 = phi - theta_1 - theta_2.
///
/// Two branches, `elbow-positive` and `elbow-negative` by the sense in which the second link is bent about z of M.
/// Singular where the links are in line, or the third axis comes over the first. No solution beyond their reach.
class ScaraInverse {
 public:
  /// Nothing if the arm has no such form.
  static std::optional<ScaraInverse> of(const SerialArm& arm);

  /// Both branches with their limits. Turning joints stand in the turn within their range if there is one, else in
  /// (-pi, pi]; with a `reference` (all joints): of several within the range in the nearest to it. Cost: 0.2 us.
  [[nodiscard]] kinematics::InverseResult solve(const Pose& X_MT, const double* reference = nullptr) const;
  /// What bounds over boxes take.
  struct Form {
    std::array<JointRange, 6> range;
    std::array<int, 3> turning;
    std::array<double, 3> sense;
    int slide;
    double slide_sense;
    double z_0, c_0;          ///< m, rad: of the tip where the joints are 0
    Vec3 origin, tip;         ///< m: o_1, and p_0 - o_3
    double first, second;     ///< m: l_1, l_2
    double direction, gamma;  ///< rad: of the first link there, and from it to the second
  };
  [[nodiscard]] Form form() const;

  static const char* branch_name(unsigned branch) { return branch % 2 == 0 ? "elbow-positive" : "elbow-negative"; }

 private:
  static constexpr int kJoints = 4;
  std::array<JointRange, 6> range_{};
  std::array<int, 3> turning_{};   ///< the joints that turn
  std::array<double, 3> sense_{};  ///< +1 or -1, about z of M
  std::array<Vec3, 3> point_{};    ///< of their axes
  int slide_ = 0;
  double slide_sense_ = 1;
  Pose X_0_;  ///< X_MT where the joints are 0
  double c_0_ = 0;
};

}  // namespace polypod::machine
