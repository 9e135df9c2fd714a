// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <type_traits>

#include "../masses.hpp"
#include "polypod/families/delta/kinematics.hpp"

namespace polypod::machine {

inline MassParts mass_parts(const RotaryDelta&) {
  return {.rods = true, .arms = true};
}
inline MassParts mass_parts(const LinearDelta&) {
  return {.rods = true, .sliders = true};
}
template <DeltaFamily M, class T>
std::vector<MassLeg<T>> mass_legs(const M& m, const PoseT<T>& X, std::span<const T> q) {
  std::vector<MassLeg<T>> out;
  out.reserve(static_cast<std::size_t>(m.arms));
  constexpr bool kCrank = std::is_same_v<M, RotaryDelta>;
  const std::vector<double> p = parameter_values(m);
  for (int i = 0; i < m.arms; ++i) {
    const auto chain = delta_detail::chain(m, X, q, std::span<const double>(p), i);
    out.push_back({chain.base.template cast<T>(), chain.end, chain.platform, false, !kCrank, kCrank});
  }
  return out;
}
/// The first elements are the drives; the rods deflect while these stand.
template <DeltaFamily M>
int joint_of_element(const M& m, int element) {
  return element < m.arms ? element : kNoJoint;
}

}  // namespace polypod::machine
