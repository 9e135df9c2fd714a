// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>

#include "../masses.hpp"
#include "polypod/families/hexapod/slider_kinematics.hpp"
#include "polypod/families/hexapod/strut_kinematics.hpp"

namespace polypod::machine {

inline MassParts mass_parts(const StrutHexapod&) {
  return {.struts = true};
}
inline MassParts mass_parts(const SliderHexapod&) {
  return {.rods = true, .sliders = true};
}
template <class T>
std::vector<MassLeg<T>> mass_legs(const StrutHexapod&, const PoseT<T>& X, std::span<const T>, std::span<const T> p) {
  std::vector<MassLeg<T>> out;
  out.reserve(kLegs);
  for (int i = 0; i < kLegs; ++i) {
    const auto leg = hexapod_detail::strut_leg(X, p, i);
    out.push_back({leg.base, leg.base, leg.end, true, false, false});
  }
  return out;
}
template <class T>
std::vector<MassLeg<T>> mass_legs(const SliderHexapod&, const PoseT<T>& X, std::span<const T> q, std::span<const T> p) {
  std::vector<MassLeg<T>> out;
  out.reserve(kLegs);
  for (int i = 0; i < kLegs; ++i) {
    const auto leg = hexapod_detail::slider_leg(X, q, p, i);
    out.push_back({leg.anchor, leg.anchor, leg.end, false, true, false});
  }
  return out;
}

}  // namespace polypod::machine
