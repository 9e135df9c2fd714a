// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A cell with each of several numbers, in all combinations.
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "polypod/cell/judge.hpp"

namespace polypod::cell {

/// A key as `--set` takes it, with the numbers that it gets.
struct SweepAxis {
  std::string key;
  std::vector<double> values;
};
struct SweepRow {
  std::vector<double> values;  ///< one an axis
  bool simulated = false;
  Estimate throughput;    ///< items a minute; 0 where it was not simulated
  double missed = 0;      ///< mean of the runs
  double floor_area = 0;  ///< m2
  std::optional<double> cost_per_item;
  std::vector<Problem> problems;
  std::vector<std::string> not_judged;
};
struct Sweep {
  std::string name;
  std::vector<SweepAxis> axes;
  std::vector<SweepRow> rows;       ///< the last axis fastest
  std::optional<std::size_t> best;  ///< of those without a problem the first with the largest throughput
  double seconds = 0;               ///< simulated, of each; 0: not the same
  int seeds = 1;
  bool complete = true;
};
/// Every row is judged by what `ask` says of its cell, with the same seeds. Errors: those of cell::read for any of the
/// combinations. `each` is called after each row; false ends the sweep.
Result<Sweep> sweep(const std::string& file, const std::vector<Override>& overrides, const std::vector<SweepAxis>& axes,
                    const std::function<CellQuestion(const Cell&)>& ask,
                    const std::function<bool(const SweepRow&)>& each = {});

/// Money that the cell's hours cost an item; none where the cell has no price of an hour, or places nothing.
std::optional<double> cost_per_item(const Cost& cost, double throughput_per_min);

}  // namespace polypod::cell
