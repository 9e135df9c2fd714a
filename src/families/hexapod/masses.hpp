// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>

#include "../masses.hpp"
#include "polypod/families/hexapod/slider_kinematics.hpp"
#include "polypod/families/hexapod/strut_kinematics.hpp"
#include "polypod/geometry/fixed_point.hpp"

namespace polypod::machine {

inline MassParts mass_parts(const StrutHexapod&) {
  return {.struts = true};
}
inline MassParts mass_parts(const SliderHexapod&) {
  return {.rods = true, .sliders = true};
}
template <class T>
std::vector<MassLeg<T>> mass_legs(const StrutHexapod& m, const PoseT<T>& X, std::span<const T>) {
  std::vector<MassLeg<T>> out;
  out.reserve(kLegs);
  for (int i = 0; i < kLegs; ++i) {
    const Vector3<T> base = m.base_joint[i].template cast<T>();
    const Vec3 in_tool = m.platform_joint[i] - Vec3(0, 0, m.tool_length);
    out.push_back({base, base, fixed_point(X, in_tool), true, false, false});
  }
  return out;
}
template <class T>
std::vector<MassLeg<T>> mass_legs(const SliderHexapod& m, const PoseT<T>& X, std::span<const T> q) {
  std::vector<MassLeg<T>> out;
  out.reserve(kLegs);
  for (int i = 0; i < kLegs; ++i) {
    Vector3<T> slider;
    for (int k = 0; k < 3; ++k) slider[k] = m.rail_outer[i][k] + q[i] * m.rail_direction[i][k];
    const Vec3 in_tool = m.platform_joint[i] - Vec3(0, 0, m.tool_length);
    out.push_back({slider, slider, fixed_point(X, in_tool), false, true, false});
  }
  return out;
}

}  // namespace polypod::machine
