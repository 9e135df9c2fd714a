// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>

#include "../masses.hpp"
#include "polypod/families/serial/kinematics.hpp"

namespace polypod::machine {

/// One link a row of the table, in the frame of that row.
inline MassParts mass_parts(const SerialArm& m) {
  MassParts out;
  out.links = static_cast<int>(m.dh.size());
  return out;
}
template <class T>
std::vector<PoseT<T>> mass_links(const SerialArm& m, std::span<const T> q) {
  std::vector<PoseT<T>> out;
  out.reserve(m.dh.size());
  const std::vector<double> p = parameter_values(m);
  chain(m, q, std::span<const double>(p), [&](const PoseT<T>& X) { out.push_back(X); });
  return out;
}
/// Elements are the rows; a joint moves as its row deflects.
inline int joint_of_element(const SerialArm& m, int element) {
  const auto row = static_cast<std::size_t>(element);
  if (m.dh[row].locked) return kHeldJoint;
  int out = 0;
  for (std::size_t k = 0; k < row; ++k) out += m.dh[k].locked ? 0 : 1;
  return out;
}

}  // namespace polypod::machine
