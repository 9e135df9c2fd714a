// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A cell judged as a whole, and its documentation: page, drawing, record.
#pragma once

#include <string>
#include <vector>

#include "polypod/cell/cell.hpp"
#include "polypod/cell/layout.hpp"
#include "polypod/cell/planning.hpp"
#include "polypod/cell/reach.hpp"
#include "polypod/cell/safety.hpp"
#include "polypod/cell/sequence.hpp"
#include "polypod/cell/simulate.hpp"

namespace polypod::pages {

struct CellQuestion {
  cell::RunSettings settings;
  int seeds = 1;
  bool compare = false;  ///< policies, and what limits the cell
};

/// Everything that is known of a cell.
struct CellResult {
  cell::Cell cell;
  cell::Motions motions;
  cell::Layout layout;
  cell::Safety safety;
  cell::Study study;  ///< without outcomes where something is out of reach
  cell::Planning planning;
  std::string policy;
  std::vector<cell::Problem> problems;  ///< of all parts; empty: the answer is yes
  std::vector<std::string> not_judged;  ///< what of this cell the answer does not answer for
  [[nodiscard]] bool simulated() const { return !study.outcomes.empty(); }
  [[nodiscard]] const cell::Outcome& outcome() const { return study.outcomes.front(); }
};
/// Judges reach, bodies, safety, and runs the cycle where all is in reach.
CellResult judge_cell(cell::Cell cell, const CellQuestion& question);

/// A row an event: time_s, step, who, what, detail. Of the first seed; empty where the run was not recorded.
std::string cell_events_csv(const CellResult& result);

/// Views from the front, the top, the left, the right and isometric, with dimensions, as one SVG file.
std::string cell_drawing(const CellResult& result);

/// One self-contained HTML file: the documentation of the cell (KOZ 2.2): task, layout, machines, cycle, throughput,
/// cost, safety, parts, sequence. The same input gives the same bytes.
std::string cell_page(const CellResult& result, const std::string& version, const std::string& command = {});

}  // namespace polypod::pages
