// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The size of a region of a task's coordinates as a person reads it.
#pragma once

#include <algorithm>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/core/units.hpp"
#include "polypod/workspace/task_directions.hpp"

namespace polypod::workspace {

/// Of x, y, z, or of the coordinates of a task without them: `unit` is "mm3", "mm deg2", "deg".
struct Region {
  double measure = 0, lower = 0, upper = 0;  ///< in that unit
  std::string unit;
};

/// "mm deg2" of mm, deg, deg.
inline std::string unit_of_product(const std::vector<const char*>& units) {
  std::string out;
  for (const char* unit : {"mm", "deg"}) {
    const auto n = std::count(units.begin(), units.end(), std::string_view(unit));
    if (n > 0) out += (out.empty() ? "" : " ") + std::string(unit) + (n > 1 ? std::to_string(n) : "");
  }
  return out;
}

/// Of measures in m and rad.
inline Region region_of(const machine::Task& task, double measure, double lower, double upper) {
  Region out{measure, lower, upper, ""};
  std::vector<const char*> of;
  for (int i = 0; i < task.size(); ++i) {
    const char* unit = unit_of(task, i);
    for (double* one : {&out.measure, &out.lower, &out.upper}) *one *= units::to_user(1, unit);
    of.push_back(unit);
  }
  out.unit = unit_of_product(of);
  return out;
}

}  // namespace polypod::workspace
