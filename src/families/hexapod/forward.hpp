// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Forward kinematics from home for both families of hexapods.
#pragma once

#include "polypod/families/hexapod/kinematics.hpp"

namespace polypod::machine::hexapod_detail {

/// Newton from home; if that does not converge, along a straight way of joints from home to q in ever finer steps.
template <class M>
Pose forward_from_home(const M& m, const JointVector& q, const JointVector& q_home) {
  const Pose home = home_pose(m);
  kinematics::NewtonResult result = newton_on_legs(six_legs(m, q), home);
  for (int steps = 4; !result.converged && steps <= 64; steps *= 4) {
    Pose X = home;
    for (int k = 1; k <= steps; ++k) {
      const JointVector q_k = q_home + (q - q_home) * (double(k) / steps);
      result = newton_on_legs(six_legs(m, q_k), X);
      if (!result.converged) break;
      X = result.X_MT;
    }
  }
  return result.X_MT;
}

}  // namespace polypod::machine::hexapod_detail
