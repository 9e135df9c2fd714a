// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A cell judged as a whole.
#pragma once

#include <string>
#include <vector>

#include "polypod/cell/cell.hpp"
#include "polypod/cell/layout.hpp"
#include "polypod/cell/planning.hpp"
#include "polypod/cell/reach.hpp"
#include "polypod/cell/safety.hpp"
#include "polypod/cell/simulate.hpp"

namespace polypod::cell {

struct CellQuestion {
  RunSettings settings;
  int seeds = 1;
  bool compare = false;     ///< policies, and what limits the cell
  bool plan = true;         ///< the planning methods
  bool only_sound = false;  ///< the cycle only where reach, bodies and guards have no problem
};

/// What the file of a cell asks by itself: its time, seed and policy.
CellQuestion question_of(const Cell& cell);

/// Everything that is known of a cell.
struct CellResult {
  Cell cell;
  Motions motions;
  Layout layout;
  Safety safety;
  Study study;  ///< without outcomes where something is out of reach
  Planning planning;
  std::string policy;
  std::vector<Problem> problems;        ///< of all parts; empty: the answer is yes
  std::vector<std::string> assumed;     ///< defaults that the file leaves, and what it says itself that it assumes
  std::vector<std::string> not_judged;  ///< what of this cell the answer does not answer for
  [[nodiscard]] bool simulated() const { return !study.outcomes.empty(); }
  [[nodiscard]] const Outcome& outcome() const { return study.outcomes.front(); }
};
/// Judges reach, bodies, safety, and runs the cycle where all is in reach.
CellResult judge_cell(Cell given, const CellQuestion& question);

}  // namespace polypod::cell
