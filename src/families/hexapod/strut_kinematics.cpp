// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/hexapod/strut_kinematics.hpp"

#include <fmt/format.h>

#include "forward.hpp"
#include "leg_inverse.hpp"

namespace polypod::machine {

LimitTable limit_table(const StrutHexapod& m) {
  return hexapod_limit_table(m, 0.5 * (m.length_min + m.length_max), m.joint.kind != JointLimitKind::none,
                             m.leg_diameter > 0, false);
}
std::string limit_name(const StrutHexapod&, int limit) {
  if (limit < HexapodLimits::kMax) return fmt::format("strut {} below its minimum length", limit + 1);
  if (limit < HexapodLimits::kBaseJoint) return fmt::format("strut {} above its maximum length", limit - 5);
  return hexapod_limit_name(limit);
}

Pose home_pose(const StrutHexapod& m) {
  return Pose{Mat3::Identity(), Vec3(0, 0, m.home.height + m.tool_length)};
}

void lengths(const StrutHexapod& m, const Pose& X, double* out) {
  const Vec3 origin = X.p - m.tool_length * X.R.col(2);
  for (int i = 0; i < kLegs; ++i) {
    out[i] = (origin + X.R * m.platform_joint[i] - m.base_joint[i]).norm() - m.leg_offset[i];
  }
}

SixLegs six_legs(const StrutHexapod& m, const JointVector& q) {
  SixLegs legs;
  legs.anchor = m.base_joint;
  for (int i = 0; i < kLegs; ++i) {
    legs.end[i] = m.platform_joint[i] - Vec3(0, 0, m.tool_length);
    legs.length[i] = q[i] + m.leg_offset[i];
  }
  return legs;
}

InverseResult inverse(const StrutHexapod& m, const Pose& X) {
  InverseResult out;
  kinematics::Solution s;
  s.joints.resize(kLegs);
  lengths(m, X, s.joints.data());
  s.violations = kinematics::violations_of_limits(m, X, s.joints);
  out.solutions.push_back(std::move(s));
  return out;
}

kinematics::NewtonResult forward_from(const StrutHexapod& m, const JointVector& q, const Pose& seed,
                                      const LegNewtonOptions& options) {
  return newton_on_legs(six_legs(m, q), seed, options);
}

Pose forward(const StrutHexapod& m, const JointVector& q) {
  JointVector q_home(kLegs);
  lengths(m, home_pose(m), q_home.data());
  return hexapod_detail::forward_from_home(m, q, q_home);
}

JacobianMatrix jacobian(const StrutHexapod& m, const Pose& X, const JointVector& q) {
  const SixLegs legs = six_legs(m, q);
  return inverse_of_legs(leg_rows(X, legs.anchor, legs.end));
}

}  // namespace polypod::machine
