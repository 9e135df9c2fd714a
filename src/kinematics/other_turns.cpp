// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/kinematics/other_turns.hpp"

#include <cmath>
#include <numbers>
#include <utility>

namespace polypod::kinematics {

std::vector<OtherTurns> other_turns(const AnyMachine& machine, const JointVector& q) {
  std::vector<OtherTurns> out;
  if (!is_serial(machine)) return out;
  constexpr double kTurn = 2 * std::numbers::pi, kMostTurns = 20, kSame = 1e-9;  // kSame in m and rad
  const ForwardResult here = forward(machine, q);
  if (here.poses.empty()) return out;
  for (int i = 0; i < joint_count(machine); ++i) {
    const machine::JointRange range = joint_range(machine, i);
    if (joint_kind(machine, i) != JointKind::revolute || !(range.max - range.min <= kMostTurns * kTurn)) continue;
    OtherTurns of{i, {}};
    for (double turns = std::ceil((range.min - q[i]) / kTurn); q[i] + turns * kTurn <= range.max; ++turns) {
      if (turns == 0) continue;
      JointVector there = q;
      there[i] += turns * kTurn;
      const ForwardResult pose = forward(machine, there);
      if (pose.poses.empty()) continue;
      const Pose &a = here.poses.front(), &b = pose.poses.front();
      if ((a.p - b.p).norm() < kSame && (a.R - b.R).norm() < kSame) of.angles.push_back(there[i]);
    }
    if (!of.angles.empty()) out.push_back(std::move(of));
  }
  return out;
}

}  // namespace polypod::kinematics
