// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "polypod/motion/dynamics.hpp"

namespace polypod::motion {

/// Legs and arms with masses that are all different, and gravity along no axis.
inline Dynamics legs_with_masses() {
  Dynamics out;
  out.gravity = Vec3(0.4, -0.9, -9.6);
  out.strut_fixed = 1.2;
  out.strut_fixed_center = 0.02;
  out.strut_fixed_inertia = 0.01;
  out.strut_moving = 0.6;
  out.strut_moving_center = 0.03;
  out.strut_moving_inertia = 0.002;
  out.rod = 0.4;
  out.slider = 0.9;
  out.arm = 0.8;
  out.arm_center = 0.07;
  out.arm_inertia = 0.008;
  return out;
}

}  // namespace polypod::motion
