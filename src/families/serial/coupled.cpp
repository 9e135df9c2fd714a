// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "coupled.hpp"

#include <cmath>
#include <numbers>

#include "six_joints.hpp"

namespace polypod::machine {

std::optional<CoupledInverse> CoupledInverse::of(const SerialArm& arm) {
  if (!arm.is_coupled()) return std::nullopt;
  constexpr double kAnyTurn = 100 * std::numbers::pi;  // rad, either way: the limits are those of the coupled joints
  CoupledInverse out;
  SerialArm without = arm;
  std::vector<int> joint_of(arm.dh.size(), -1);
  for (std::size_t i = 0; i < arm.dh.size(); ++i) {
    const DhRow& row = arm.dh[i];
    const bool turns = row.kind == JointKind::revolute;
    without.dh[i].coupled_back = 0;
    without.dh[i].coupling = 0;
    if (turns && !row.locked) without.dh[i].range = {-kAnyTurn, kAnyTurn};
    if (row.locked) {
      if (row.coupled_back > 0) return std::nullopt;
      continue;
    }
    joint_of[i] = static_cast<int>(out.joints_.size());
    Joint joint;
    joint.range = row.range;
    joint.turns = turns;
    if (row.coupled_back > 0) {
      const std::size_t source = i - static_cast<std::size_t>(row.coupled_back);
      const double factor = row.sign * row.coupling;
      joint.of = joint_of[source];
      joint.factor = joint.of < 0 ? 0 : factor;
      joint.shift = joint.of < 0 ? factor * *arm.dh[source].locked : 0;
    }
    out.joints_.push_back(joint);
  }
  out.without_ = ClosedInverse::of(without);
  if (!out.without_.exists()) return std::nullopt;
  return out;
}

kinematics::InverseResult CoupledInverse::solve(const Pose& X_MT, const double* reference) const {
  const auto by_others = [&](std::size_t i, const double* q) {
    const Joint& joint = joints_[i];
    return joint.shift + (joint.of < 0 ? 0 : joint.factor * q[joint.of]);
  };
  std::vector<double> seen;
  for (std::size_t i = 0; reference != nullptr && i < joints_.size(); ++i)
    seen.push_back(reference[i] + by_others(i, reference));
  kinematics::InverseResult out = without_.solve(X_MT, reference == nullptr ? nullptr : seen.data());
  for (kinematics::Solution& s : out.solutions) {
    s.violations = 0;
    for (std::size_t i = 0; i < joints_.size(); ++i) {
      double& q = s.joints[static_cast<Eigen::Index>(i)];
      const JointRange& range = joints_[i].range;
      q -= by_others(i, s.joints.data());
      if (joints_[i].turns) {
        q = six::in_range(std::remainder(q, 2 * std::numbers::pi), range, reference, static_cast<int>(i));
      }
      const bool low = q<range.min - six::kLimitSlack, high = q> range.max + six::kLimitSlack;
      s.violations |= kinematics::LimitBits{low} << (2 * i) | kinematics::LimitBits{high} << (2 * i + 1);
    }
  }
  return out;
}

}  // namespace polypod::machine
