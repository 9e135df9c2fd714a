// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <type_traits>

#include "../leg_series.hpp"
#include "polypod/families/delta/kinematics.hpp"

namespace polypod::machine {

/// The platform does not turn.
template <DeltaFamily M>
QuickSeries quick_series(const M& m, const PoseT<Series>& target, const Pose& at, const JointVector& q) {
  QuickSeries out{{at.R.cast<Series>(), target.p}, JointVectorT<Series>(q.size())};
  for (int i = 0; i < m.arms; ++i) {
    const Vec3 joint = at.R * (m.platform_joint[i] - m.tool);
    const auto from = [&](const Vec3& point) {
      Vector3<Series> y = target.p;
      for (int k = 0; k < 3; ++k) y[k][0] += joint[k] - point[k];
      return y;
    };
    if constexpr (std::is_same_v<M, RotaryDelta>) {
      add_crank(i, from(m.base_joint[i]), m.outward[i], m.arm_length[i], m.zero[i], m.rod_length[i], q[i], out);
    } else {
      add_rail(i, from(m.rail_start[i]), m.rail_direction[i], m.rod_length[i], q[i], out);
    }
  }
  return out;
}

}  // namespace polypod::machine
