// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <random>

#include "polypod/families/serial/kinematics.hpp"

namespace polypod::test {

/// Joints within the limits of an arm, a fiftieth of each range off its ends.
inline machine::JointVector within_limits(const machine::SerialArm& arm, std::mt19937& random) {
  std::uniform_real_distribution<double> unit(0.02, 0.98);
  machine::JointVector q(arm.free_joints());
  for (int i = 0; i < arm.free_joints(); ++i) {
    const machine::JointRange r = joint_range(arm, i);
    q[i] = r.min + unit(random) * (r.max - r.min);
  }
  return q;
}

}  // namespace polypod::test
