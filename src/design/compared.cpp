// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/design/compared.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "polypod/design/optimize.hpp"

namespace polypod::design {
namespace {

bool are_of(const std::vector<Row>& rows, const Study& study) {
  return std::equal(rows.begin(), rows.end(), study.compared.begin(), study.compared.end(),
                    [](const Row& row, const Compared& one) { return row.varied == one.varied; });
}

/// The goals, more is better.
std::vector<double> goals_of(const Study& study, const Row& row) {
  std::vector<double> out;
  for (std::size_t k = 0; k < study.goals.size(); ++k) {  // goals come first among the figures
    const double value = row.evaluation.figures[k].value;
    out.push_back(study.goals[k].maximise ? value : -value);
  }
  return out;
}

}  // namespace

Result<std::vector<Row>> judge_compared(const Study& study, Store& store, const EvaluateOptions& options,
                                        const std::function<void(double)>& progress) {
  POLYPOD_ASSIGN(kept, store.compared());
  if (are_of(kept, study)) return kept;
  std::vector<Row> out;
  for (const Compared& one : study.compared) {
    if (progress) progress(static_cast<double>(out.size()) / static_cast<double>(study.compared.size()));
    Row row;
    row.row = static_cast<std::int64_t>(out.size()) + 1;
    row.varied = one.varied;
    POLYPOD_ASSIGN(evaluation, evaluate(study, one.varied, {}, options));
    row.evaluation = std::move(evaluation);
    out.push_back(std::move(row));
  }
  if (progress) progress(1);
  POLYPOD_TRY(store.set_compared(out));
  return out;
}

Result<std::vector<Row>> kept_compared(const Store& store) {
  POLYPOD_ASSIGN(kept, store.compared());
  if (!are_of(kept, store.study())) kept.clear();
  return kept;
}

Standing standing_of(const Study& study, const std::vector<Row>& rows, const Row& known) {
  Standing out;
  out.outside = !as_candidate(study, known.varied);
  if (known.evaluation.state != State::done) {
    out.is = Standing::Is::no_solution;
    out.reason = known.evaluation.reason;
    return out;
  }
  if (study.wants_front()) {
    const std::vector<std::size_t> front = front_of(study, rows);
    if (front.empty()) return out;
    const std::vector<double> goals = goals_of(study, known);
    out.is = Standing::Is::not_dominated;
    for (const std::size_t i : front) {
      const std::vector<double> point = goals_of(study, rows[i]);
      if (dominates(goals, point)) ++out.dominates;
      if (out.is == Standing::Is::dominated || !dominates(point, goals)) continue;
      out.is = Standing::Is::dominated;
      out.by = rows[i].row;
    }
    return out;
  }
  const auto best = best_of(study, rows);
  if (!best) return out;
  const Value &found = rows[*best].evaluation.objective, &is = known.evaluation.objective;
  out.is = is.lower > found.upper   ? Standing::Is::better
           : is.upper < found.lower ? Standing::Is::worse
                                    : Standing::Is::alike;
  return out;
}

const char* name_of(Standing::Is is) {
  switch (is) {
    case Standing::Is::no_solution:
      return "no solution";
    case Standing::Is::worse:
      return "worse";
    case Standing::Is::alike:
      return "alike";
    case Standing::Is::better:
      return "better";
    case Standing::Is::dominated:
      return "dominated";
    case Standing::Is::not_dominated:
      return "not dominated";
    case Standing::Is::alone:
      break;
  }
  return "alone";
}

std::string in_words(const Standing& s) {
  const std::string outside = s.outside ? " (no candidate of the study)" : "";
  switch (s.is) {
    case Standing::Is::no_solution:
      return "no solution: " + s.reason;
    case Standing::Is::worse:
      return "worse than the best" + outside;
    case Standing::Is::alike:
      return "its bounds overlap with those of the best" + outside;
    case Standing::Is::better:
      return "better than the best that was found" + outside;
    case Standing::Is::dominated:
      return fmt::format("dominated by row {} of the front{}", s.by, outside);
    case Standing::Is::not_dominated:
      return s.dominates > 0
                 ? fmt::format("not dominated, and dominates {} points of the front{}", s.dominates, outside)
                 : "not dominated" + outside;
    case Standing::Is::alone:
      break;
  }
  return "nothing was found to compare it with";
}

std::string advice(const Study& study, const std::vector<Row>& rows, const std::vector<Row>& known) {
  bool within = false, better = false;
  for (const Row& row : known) {
    const Standing s = standing_of(study, rows, row);
    better = better || s.is == Standing::Is::better;
    within = within || (s.is == Standing::Is::better && !s.outside);
  }
  if (!better) return {};
  return std::string("a machine that is known is better than the best that was found. ") +
         (within ? "Search longer, or with another seed" : "It is no candidate of the study: widen its ranges");
}

bool beaten(const Study& study, const std::vector<Row>& rows, const std::vector<Row>& known) {
  return std::any_of(known.begin(), known.end(),
                     [&](const Row& row) { return standing_of(study, rows, row).is == Standing::Is::better; });
}

}  // namespace polypod::design
