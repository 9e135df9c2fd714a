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
inline PoseT<Series> mass_link(const SerialArm& m, std::size_t row, std::span<const Series> q,
                               std::span<const Series> p) {
  SerialArm partial = m;
  partial.X_FT = Pose{};
  partial.dh.assign(m.dh.begin(), m.dh.begin() + static_cast<std::ptrdiff_t>(row + 1));
  std::size_t joints = 0;
  for (const DhRow& r : partial.dh) joints += r.locked ? 0 : 1;
  return chain(partial, q.subspan(0, joints), p);
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
