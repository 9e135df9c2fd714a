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

/// Deltas, on the first roots of their drives. A turned tool is out of reach.
template <machine::DeltaFamily M>
class DeltaJudge {
 public:
  static constexpr int kBranches = 1;
  std::vector<Slot> slots;

  DeltaJudge(const M& m, const Options& options)
      : slots(slots_of(m, options)),
        m_(m),
        singular_(options.singular_distance),
        p_(kinematics::nominal_parameters(m)) {
    slots.push_back({kOutOfReach, 1});
    if (singular_ > 0) slots.push_back({kNearSingular, 1});
  }
  [[nodiscard]] static std::vector<Vec3> critical(const Vec3&) { return {}; }

  void values(const Pose& X, double* out) const {
    if (!X.R.isIdentity(1e-9)) {
      std::fill_n(out, slots.size(), -kUnknown);
      return;
    }
    machine::JointVector q(m_.arms);
    double reach = kUnknown;
    for (int i = 0; i < m_.arms; ++i) {
      const machine::DriveRoots roots = drive_roots(m_, i, X.p);
      q[i] = roots.first;
      reach = std::min(reach, machine::reach_of(m_, i, X.p));
    }
    const std::vector<double> g =
        limits(m_, X, std::span<const double>(q.data(), q.size()), std::span<const double>(p_));
    for (const Slot& slot : slots) {
      if (slot.limit == kOutOfReach) {
        *out++ = reach;
      } else if (slot.limit == kNearSingular) {
        const machine::Closeness close = closeness(m_, X.p);
        *out++ = close.reached ? close.least() - singular_ : reach;
      } else {
        *out++ = slot.scale * g[static_cast<std::size_t>(slot.limit)];
      }
    }
  }

 private:
  const M& m_;
  double singular_;
  std::vector<double> p_;
};

template <machine::DeltaFamily M>
std::optional<DeltaJudge<M>> pose_judge(const M& m, const Options& options) {
  return DeltaJudge<M>(m, options);
}

}  // namespace polypod::workspace
