// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the judges of families have in common.
#pragma once

#include <span>
#include <vector>

#include "polypod/kinematics/closure.hpp"
#include "polypod/kinematics/families.hpp"
#include "polypod/workspace/field.hpp"

namespace polypod::workspace {

/// What a branch that does not exist here says of its other limits.
inline constexpr double kUnknown = 1e3;

/// A limit that is looked at: its index and what its value is multiplied with to give m.
struct Slot {
  int limit = 0;
  double scale = 1;
};

/// The limits that are heeded and given.
template <class M>
std::vector<Slot> slots_of(const M& m, const Options& options) {
  std::vector<Slot> out;
  const machine::LimitTable table = limit_table(m);
  for (std::size_t i = 0; i < table.size(); ++i) {
    if ((options.limits >> i & 1U) == 0 || !table[i].given || (table[i].between_bodies && !options.interference))
      continue;
    out.push_back({static_cast<int>(i), table[i].scale});
  }
  return out;
}

}  // namespace polypod::workspace
