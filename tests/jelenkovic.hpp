// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The printed tables of JEL 8 and the machines of their rows.
#pragma once

#include <gtest/gtest.h>

#include <fstream>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "paths.hpp"
#include "polypod/core/units.hpp"
#include "polypod/families/hexapod/strut_kinematics.hpp"
#include "polypod/machine/any_machine.hpp"

namespace polypod::jelenkovic {

/// A row: the cells of the parameters as text, and the printed numbers.
struct Row {
  std::vector<std::string> keys;
  std::vector<double> printed;
};

/// The rows of <room>/data/table_<number>.csv, of which the first `keys` columns are parameters.
inline std::vector<Row> table(const std::string& room, const std::string& number, std::size_t keys) {
  std::ifstream file(test::source("tests/" + room + "/data/table_" + number + ".csv"));
  std::vector<Row> rows;
  std::string line;
  bool header = true;
  while (std::getline(file, line)) {
    if (line.empty() || line[0] == '#') continue;
    if (std::exchange(header, false)) continue;
    Row row;
    std::stringstream fields(line);
    for (std::string field; std::getline(fields, field, ',');) {
      if (row.keys.size() < keys)
        row.keys.push_back(field);
      else
        row.printed.push_back(std::stod(field));
    }
    EXPECT_FALSE(row.printed.empty());
    rows.push_back(row);
  }
  EXPECT_FALSE(rows.empty()) << number;
  return rows;
}

using Overrides = std::vector<machine::Override>;

inline machine::AnyMachine machine_of(const std::string& name, const Overrides& overrides) {
  const auto m = machine::load(name, overrides);
  EXPECT_TRUE(m) << to_string(m.error());
  return *m;
}

/// The home height of a row of the strut tables. The source moved home "to the middle" with the longest struts and the
/// radii (`moved`): to where the struts have their mean length. Elsewhere it stayed at 65 where the struts reach that.
inline Overrides strut_home(const Overrides& overrides, bool moved) {
  const auto at_65 = std::get<machine::StrutHexapod>(machine_of("hexapod-strut", overrides));
  double lengths[machine::kLegs];
  machine::lengths(at_65, machine::home_pose(at_65), lengths);
  if (!moved && lengths[0] > at_65.length_min && lengths[0] < at_65.length_max) return {};
  const double middle = 0.5 * (at_65.length_min + at_65.length_max);
  const double across2 = lengths[0] * lengths[0] - 0.065 * 0.065;
  if (middle * middle <= across2) return {};
  return {{"home.height_mm", std::to_string(units::to_mm(std::sqrt(middle * middle - across2)))}};
}

}  // namespace polypod::jelenkovic
