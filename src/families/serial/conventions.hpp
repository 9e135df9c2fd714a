// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>

#include <string>
#include <vector>

#include "polypod/core/units.hpp"
#include "polypod/families/serial/machine.hpp"

namespace polypod::machine {

inline std::vector<std::string> conventions_of(const SerialArm& arm) {
  std::vector<std::string> out;
  out.push_back(arm.convention == DhConvention::modified
                    ? "the table dh is in the modified convention (Craig): a and alpha of a row come before its joint"
                    : "the table dh is in the standard convention: a and alpha of a row come after its joint");
  std::vector<std::string> of_row;  // what the joint of each row is called
  int joint = 0;
  for (std::size_t i = 0; i < arm.dh.size(); ++i) {
    const DhRow& row = arm.dh[i];
    of_row.push_back(row.locked ? fmt::format("the locked joint of row {}", i + 1) : fmt::format("joint {}", ++joint));
    const bool turns = row.kind == JointKind::revolute;
    if (row.sign < 0) out.push_back(fmt::format("{} counts against z of row {} (sign -1)", of_row[i], i + 1));
    const auto user = [&](double value) { return (turns ? units::to_deg(value) : units::to_mm(value)) + 0.0; };
    if (row.coupled_back > 0) {
      const std::string& leader = of_row[i - static_cast<std::size_t>(row.coupled_back)];
      const std::string by = fmt::format("by {:g} deg for each of its degrees (coupling)", row.coupling);
      out.push_back(row.locked ? fmt::format("row {} has no drive: it turns with {}, {}, from {:.6g} deg on", i + 1,
                                             leader, by, user(*row.locked))
                               : fmt::format("row {} turns with {}, too: {}", i + 1, leader, by));
    } else if (row.locked) {
      out.push_back(fmt::format("row {} is locked at {:.6g} {}", i + 1, user(*row.locked), turns ? "deg" : "mm"));
    }
  }
  return out;
}

}  // namespace polypod::machine
