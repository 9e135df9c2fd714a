// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Machines that are known already, beside what a search found.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "polypod/design/optimize.hpp"

namespace polypod::design {

/// What a search found: its rows, and what a finer survey says of the answer.
struct Answer {
  const Study& study;
  const std::vector<Row>& rows;
  const std::optional<JudgedAgain>& again;
};

/// Study::compared, judged as the answer is: over the finer survey where that was judged again. Row k + 1 is that of
/// compared[k].
struct Known {
  int resolution = 0;  ///< of the survey
  std::vector<Row> rows;
};

/// A search judged to its end.
struct Judged {
  std::optional<JudgedAgain> again;
  Known known;
};
/// The answer over a finer survey: the best; without one the points of the front where the study has holds that they
/// may break; none where no figure or hold is of a survey, and of cells. And Study::compared over the same survey, all
/// of them at a time. The store keeps both, and what it has of a known machine is not computed again. `progress` gets
/// the share that is done. Errors: WS110 (cancelled), those of the store.
Result<Judged> judge_finer(const Study& study, Store& store, const Outcome& outcome, Crew& crew,
                           const std::function<void(double)>& progress = {});
/// What the store has of them: no rows where the study compares with others now, or not all are done.
Result<Known> kept_compared(const Store& store);

/// Where a known machine stands beside the best of a search, or beside a front.
struct Standing {
  enum class Is : std::uint8_t {
    no_solution,    ///< it breaks a hold, or is no machine: `reason`
    worse,          ///< of one best: its objective is certainly smaller
    alike,          ///< their bounds overlap
    better,         ///< certainly larger, or the best breaks a hold on the finer survey
    dominated,      ///< of a front: a point is certainly better in a goal and worse in none
    not_dominated,  ///< no point certainly is
    alone,          ///< it keeps all holds, and the search found nothing that does
  };
  Is is = Is::alone;
  std::string reason;
  std::int64_t by = 0;   ///< row of the first point of the front that dominates it
  int dominated_by = 0;  ///< how many do
  int dominates = 0;     ///< points of the front that it dominates
  bool outside = false;  ///< it is no candidate: outside of the ranges, or beside the steps and lists
};
/// Where one of Known::rows stands. What is said holds for all values within the proven bounds of volumes; figures that
/// a study surveys are means over samples, and count as they are.
Standing standing_of(const Answer& answer, const Row& known);
/// "no solution", "worse", "alike", "better", "dominated", "not dominated", "alone".
const char* name_of(Standing::Is is);
/// "worse than the best", "dominated by 3 points of the front, the first of them row 12", ...
std::string in_words(const Standing& standing);
/// What to say and do where one of them is certainly better than the best of the search, or keeps holds that nothing
/// else keeps; empty where none is.
std::string advice(const Answer& answer, const std::vector<Row>& known);

}  // namespace polypod::design
