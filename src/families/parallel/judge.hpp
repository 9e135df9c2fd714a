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

/// Machines of legs, on the roots that they take.
class ParallelJudge {
 public:
  static constexpr int kBranches = 1;
  std::vector<Slot> slots;

  ParallelJudge(const machine::Parallel& m, const Options& options)
      : slots(slots_of(m, options)), m_(m), p_(kinematics::nominal_parameters(m)) {
    slots.push_back({kOutOfReach, 1});
  }
  [[nodiscard]] static std::vector<Vec3> critical(const Vec3&) { return {}; }

  void values(const Pose& target, double* out) const {
    const std::optional<Pose> X = settled(m_, target);
    double reach = X ? kUnknown : -kUnknown;
    machine::JointVector q(joint_count(m_));
    for (int j = 0; X && j < q.size(); ++j) {
      const machine::LegRoots roots = leg_roots(m_, driven_leg(m_, j), *X);
      if (driven_leg(m_, j).two_roots()) reach = std::min(reach, roots.under / driven_leg(m_, j).rod);
      q[j] = roots.low;
    }
    std::vector<double> g;
    if (X) {
      if (const auto taken = joints_of(m_, *X)) q = *taken;
      g = limits(m_, *X, std::span<const double>(q.data(), static_cast<std::size_t>(q.size())),
                 std::span<const double>(p_));
    }
    for (const Slot& slot : slots) {
      *out++ = slot.limit == kOutOfReach ? reach : X ? slot.scale * g[static_cast<std::size_t>(slot.limit)] : kUnknown;
    }
  }

 private:
  const machine::Parallel& m_;
  std::vector<double> p_;
};

inline std::optional<ParallelJudge> pose_judge(const machine::Parallel& m, const Options& options) {
  return ParallelJudge(m, options);
}

}  // namespace polypod::workspace
