// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/kinematics/joint_speed.hpp"

#include <fmt/format.h>

#include <cmath>

#include "polypod/core/units.hpp"

namespace polypod::kinematics {
namespace {

constexpr double kCloserFrom = 0.2;  // of a joint's limit, from which its speed is judged at closer poses
constexpr int kCloser = 10;          // pieces of the way then

FastestJoint between(const JointVector& from, const JointVector& to, double seconds,
                     const std::vector<double>& limits) {
  FastestJoint out;
  for (int i = 0; i < static_cast<int>(to.size()); ++i) {
    const double share = std::abs(to[i] - from[i]) / (seconds * limits[static_cast<std::size_t>(i)]);
    if (share > out.share) out = {i, share};
  }
  return out;
}

}  // namespace

FastestJoint fastest_joint(const AnyMachine& machine, const JointVector& from, const JointVector& to, double seconds,
                           const std::vector<double>& limits, const std::function<Pose(double)>& pose) {
  FastestJoint out = between(from, to, seconds, limits);
  if (out.share <= kCloserFrom) return out;
  JointVector last = from;
  for (int k = 1; k <= kCloser; ++k) {
    JointVector next = to;
    if (k < kCloser) {
      const InverseResult inverse = inverse_near(machine, pose(double(k) / kCloser), last);
      const Solution* best = inverse.reachable();
      if (best == nullptr) continue;
      next = best->joints;
    }
    if (const FastestJoint closer = between(last, next, seconds / kCloser, limits); closer.share > out.share)
      out = closer;
    last = next;
  }
  return out;
}

std::string too_fast(const AnyMachine& machine, const FastestJoint& fastest, const std::vector<double>& limits) {
  const bool turns = joint_kind(machine, fastest.joint) == JointKind::revolute;
  const double limit = limits[static_cast<std::size_t>(fastest.joint)];
  const auto user = [&](double v) { return turns ? units::to_deg(v) : units::to_mm(v); };
  return fmt::format("joint {} would go at {:.1f} {} where its limit is {:.1f}", fastest.joint + 1,
                     user(fastest.share * limit), turns ? "deg/s" : "mm/s", user(limit));
}

}  // namespace polypod::kinematics
