// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Whether a whole turn of one joint alone leaves the tool where it is: a question that families answer with
// turns_alone(m, joint) where it may not.
#pragma once

#include <cmath>

#include "polypod/families/stages/kinematics.hpp"

namespace polypod::machine {

/// Not of a joint that turns another row by a share that is no whole number.
inline bool turns_alone(const SerialArm& arm, int joint) {
  const DhRow* leader = nullptr;
  int seen = 0;
  for (const DhRow& row : arm.dh)
    if (!row.locked && seen++ == joint) leader = &row;
  for (std::size_t i = 0; i < arm.dh.size(); ++i) {
    const DhRow& row = arm.dh[i];
    if (row.coupled_back == 0 || &arm.dh[i - static_cast<std::size_t>(row.coupled_back)] != leader) continue;
    if (row.coupling != std::round(row.coupling)) return false;
  }
  return true;
}

inline bool turns_alone(const Stages& m, int joint) {
  std::size_t k = 0;
  while (k + 1 < m.machines.size() && joint >= m.data[k].joints) joint -= m.data[k++].joints;
  const auto* arm = std::get_if<SerialArm>(&m.machines[k]);
  return arm == nullptr || turns_alone(*arm, joint);
}

}  // namespace polypod::machine
