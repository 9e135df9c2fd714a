// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The closed inverse of arms with six joints and a spherical wrist, whatever their first three axes.
#pragma once

#include <array>
#include <optional>

#include "polypod/families/serial/spherical_wrist.hpp"

namespace polypod::machine {

/// Inverse kinematics of arms with six free turning joints whose axes 4, 5 and 6 meet in the wrist centre W, while axes
/// 1 to 3 stand anyhow (Pieper 1968). With v = e_3 W - o_2 (linear in the cosine and sine of joint 3), d the common
/// normal from axis 1 to axis 2, and p the wanted W:
///   u_1 . (d + R_2 v) = u_1 . (p - o_1),  |d + R_2 v|^2 = |p - o_1|^2;
/// both are linear in the cosine and sine of joint 2, whose squares add up to 1: one equation for joint 3, of degree
/// two in its cosine and sine, that is a quartic with up to four real roots. Parallel or intersecting axes 1 and 2 make
/// it two equations of degree one. Then joints 2 and 1 by one angle each, and the wrist as in SphericalWristInverse.
///
/// Up to eight branches `arm-1 .. arm-4 [wrist-flipped]`; arm-1 has the smallest joint 3 in (-180, 180] deg, and so on:
/// numbers, because nothing else tells these postures apart on every such arm.
/// Singular, and marked so: axes 4 and 6 in line, W on axis 1, two roots that are one (within 1e-6 rad of joint 3).
/// Cost: some 10 us.
class PieperInverse {
 public:
  using Branches = SixJointBranches;

  /// Nothing if axes 4, 5 and 6 do not meet, or if the first three joints cannot move W in all directions anywhere.
  static std::optional<PieperInverse> of(const SerialArm& arm);

  /// All branches of the pose X_MT, turns and reference as in SphericalWristInverse. No allocation.
  void solve(const Pose& X_MT, Branches& out, const double* reference = nullptr) const;
  /// The same with limits, as a list.
  [[nodiscard]] kinematics::InverseResult solve(const Pose& X_MT, const double* reference = nullptr) const;

  /// Two bits a joint, in the order of `limits`.
  [[nodiscard]] kinematics::LimitBits violations(const double* joints) const;

 private:
  std::array<JointRange, 6> range_;
  std::array<Vec3, 6> u_;  ///< directions of the axes in M at joints 0
  Vec3 o1_;                ///< the foot of the common normal on axis 1
  Pose X_0_inverse_;
  Vec3 W_;
  Vec3 n_, e_;                        ///< square to axis 2: along the common normal, and u_2 x n
  double a_ = 0, cos_ = 0, sin_ = 0;  ///< the common normal's length, the twist of axis 1 against axis 2
  Vec3 k0_, kc_, ks_;                 ///< v = k0 + kc cos q3 + ks sin q3
};

}  // namespace polypod::machine
