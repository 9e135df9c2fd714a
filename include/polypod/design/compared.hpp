// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Machines that are known already, beside what a search found.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "polypod/design/store.hpp"

namespace polypod::design {

/// Study::compared, judged as candidates are, to the study's own tolerance; row k + 1 is that of compared[k]. The store
/// keeps them, and what it has of the same values is not computed again. `progress` gets the share that is done.
/// Errors: WS110 (cancelled), those of the store.
Result<std::vector<Row>> judge_compared(const Study& study, Store& store, const EvaluateOptions& options,
                                        const std::function<void(double)>& progress = {});
/// What the store has of them: empty where the study compares with others now.
Result<std::vector<Row>> kept_compared(const Store& store);

/// Where a known machine stands beside the best of a search, or beside a front.
struct Standing {
  enum class Is : std::uint8_t {
    no_solution,    ///< it breaks a hold, or is no machine: `reason`
    worse,          ///< of one best: its objective is certainly smaller
    alike,          ///< their bounds overlap
    better,         ///< certainly larger
    dominated,      ///< of a front: the point `by` is better in a goal and worse in none
    not_dominated,  ///< no point is
    alone,          ///< the search found nothing to compare with
  };
  Is is = Is::alone;
  std::string reason;
  std::int64_t by = 0;   ///< row of the point that dominates it, the first of the front
  int dominates = 0;     ///< points of the front that it dominates
  bool outside = false;  ///< it is no candidate: outside of the ranges, or beside the steps and lists
};
/// `rows` of the search; `known` of judge_compared. Figures that a study surveys are means over samples: points of a
/// front are compared by their values.
Standing standing_of(const Study& study, const std::vector<Row>& rows, const Row& known);
/// "no solution", "worse", "alike", "better", "dominated", "not dominated", "alone".
const char* name_of(Standing::Is is);
/// "worse than the best", "dominated by row 12 of the front", ...
std::string in_words(const Standing& standing);
/// What to say and do where the best of the search is certainly worse than one of them; empty where it is not.
std::string advice(const Study& study, const std::vector<Row>& rows, const std::vector<Row>& known);
/// Whether it is.
bool beaten(const Study& study, const std::vector<Row>& rows, const std::vector<Row>& known);

}  // namespace polypod::design
