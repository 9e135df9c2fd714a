// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The limits at one pose, for fields of margins (see src/workspace/margin.cpp).
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "../../workspace/judge.hpp"

namespace polypod::workspace {

/// Hexapods on struts or sliders.
template <class Hexapod>
class HexapodJudge {
 public:
  static constexpr int kBranches = 1;
  std::vector<Slot> slots;

  HexapodJudge(const Hexapod& m, const Options& options)
      : slots(slots_of(m, options)), m_(m), p_(kinematics::nominal_parameters(m)) {
    if constexpr (requires { m.rail_length; }) slots.push_back({kOutOfReach, 1});
  }

  /// Limits of hexapods have no holes between the samples.
  [[nodiscard]] static std::vector<Vec3> critical(const Vec3&) { return {}; }

  void values(const Pose& X, double* out) const {
    machine::JointVector q(machine::kLegs);
    double reach = kUnknown;
    if constexpr (requires { m_.rail_length; }) {
      const Vec3 origin = X.p - m_.tool_length * X.R.col(2);
      for (int i = 0; i < machine::kLegs; ++i) {
        const Vec3& u = m_.rail_direction[i];
        const Vec3 y = origin + X.R * m_.platform_joint[i] - m_.rail_outer[i];
        const double along = u.dot(y), across = (y - along * u).norm();
        reach = std::min(reach, m_.length_of_leg(i) - across);
        const double half = std::sqrt(std::max(0.0, m_.length_of_leg(i) * m_.length_of_leg(i) - across * across));
        // The root nearer the outer end where both are on the rail, else the one nearer the rail.
        const auto off = [&](double at) { return std::max({-at, at - m_.rail_length[i], 0.0}); };
        q[i] = off(along + half) < off(along - half) ? along + half : along - half;
      }
    } else {
      machine::lengths(m_, X, q.data());
    }
    const std::vector<double> g =
        limits(m_, X, std::span<const double>(q.data(), machine::kLegs), std::span<const double>(p_));
    for (const Slot& slot : slots)
      *out++ = slot.limit == kOutOfReach ? reach : slot.scale * g[static_cast<std::size_t>(slot.limit)];
  }

 private:
  const Hexapod& m_;
  std::vector<double> p_;
};

inline std::optional<HexapodJudge<machine::StrutHexapod>> pose_judge(const machine::StrutHexapod& m,
                                                                     const Options& options) {
  return HexapodJudge<machine::StrutHexapod>(m, options);
}
inline std::optional<HexapodJudge<machine::SliderHexapod>> pose_judge(const machine::SliderHexapod& m,
                                                                      const Options& options) {
  return HexapodJudge<machine::SliderHexapod>(m, options);
}

}  // namespace polypod::workspace
