// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/kinematics/posture.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <variant>

#include "polypod/families/serial/kinematics.hpp"

namespace polypod::kinematics {

const Solution* reachable_in(const AnyMachine& machine, const InverseResult& inverse, const std::string& posture) {
  if (posture.empty()) return inverse.reachable();
  for (const Solution& s : inverse.solutions)
    if (s.violations == 0 && branch_name(machine, s.branch) == posture) return &s;
  return nullptr;
}

namespace {
std::vector<std::string> names_of(const AnyMachine& machine, const InverseResult& inverse, bool within_limits) {
  std::vector<std::string> out;
  for (const Solution& s : inverse.solutions) {
    if ((within_limits && s.violations != 0) || s.branch >= kNumericBranch) continue;
    std::string name = branch_name(machine, s.branch);
    if (std::find(out.begin(), out.end(), name) == out.end()) out.push_back(std::move(name));
  }
  return out;
}
}  // namespace

std::vector<std::string> postures_of(const AnyMachine& machine, const InverseResult& inverse) {
  return names_of(machine, inverse, true);
}

std::vector<std::string> all_postures(const AnyMachine& machine) {
  if (const auto* arm = std::get_if<machine::SerialArm>(&machine); arm != nullptr && names_branches(*arm)) {
    constexpr unsigned kMost = 8;
    std::vector<std::string> out;
    for (unsigned branch = 0; branch < kMost; ++branch) {
      std::string name = branch_name(*arm, branch);
      if (std::find(out.begin(), out.end(), name) == out.end()) out.push_back(std::move(name));
    }
    return out;
  }
  JointVector q(joint_count(machine));
  for (Eigen::Index i = 0; i < q.size(); ++i) {
    const machine::JointRange range = joint_range(machine, static_cast<int>(i));
    // Off the middle, where joints are often stretched out and two postures are one.
    constexpr double kBeside = 0.43;
    q[i] = std::isfinite(range.max - range.min) ? range.min + kBeside * (range.max - range.min) : 0.4;
  }
  const ForwardResult at = kinematics::forward(machine, q);
  if (at.poses.empty()) return {};
  return names_of(machine, inverse(machine, at.poses.front()), false);
}

std::string posture_of(const AnyMachine& machine, const JointVector& q) {
  const ForwardResult forward = kinematics::forward(machine, q);
  if (forward.poses.empty()) return {};
  const InverseResult inverse = inverse_near(machine, forward.poses.front(), q);
  if (inverse.solutions.empty()) return {};
  const auto nearest =
      std::min_element(inverse.solutions.begin(), inverse.solutions.end(), [&](const Solution& a, const Solution& b) {
        return (a.joints - q).cwiseAbs().maxCoeff() < (b.joints - q).cwiseAbs().maxCoeff();
      });
  return nearest->branch < kNumericBranch ? branch_name(machine, nearest->branch) : std::string();
}

std::string reason_of(const AnyMachine& machine, const InverseResult& inverse, const std::string& posture) {
  if (posture.empty() || inverse.reachable() == nullptr) return reason_of(machine, inverse);
  const std::vector<std::string> others = postures_of(machine, inverse);
  return fmt::format("not within the limits in the posture {}{}", posture,
                     others.empty() ? "" : fmt::format("; in {}", fmt::join(others, ", ")));
}

}  // namespace polypod::kinematics
