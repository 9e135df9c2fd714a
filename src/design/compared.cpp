// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/design/compared.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>

namespace polypod::design {
namespace {

constexpr const char* kResolution = "compared_resolution";

/// The first of the rows that are of the study's list.
void keep_what_is_of(const Study& study, std::vector<Row>& rows) {
  std::size_t same = 0;
  while (same < rows.size() && same < study.compared.size() && rows[same].varied == study.compared[same].varied) ++same;
  rows.resize(same);
}

/// What a finer survey says of a row, else what the search says.
const Evaluation& judged(const Answer& answer, const Row& row) {
  if (answer.again) {
    for (const Row& again : answer.again->rows)
      if (again.row == row.row) return again.evaluation;
  }
  return row.evaluation;
}

/// The best; without one the points of the front where there are holds that they may break.
std::vector<Row> answer_to_judge(const Study& study, const Outcome& outcome) {
  std::vector<Row> out;
  if (!may_flatter(study)) return out;
  if (outcome.best) {
    out.push_back(outcome.rows[*outcome.best]);
  } else if (!study.holds.empty()) {
    for (const std::size_t i : outcome.front) out.push_back(outcome.rows[i]);
  }
  return out;
}

}  // namespace

Result<Judged> judge_finer(const Study& study, Store& store, const Outcome& outcome, Crew& crew,
                           const std::function<void(double)>& progress) {
  const std::vector<Row> answer = answer_to_judge(study, outcome);
  Judged out;
  if (!answer.empty()) out.again = JudgedAgain{std::min(kFinestResolution, 2 * study.resolution), answer};
  Known& known = out.known;
  known.resolution = out.again ? out.again->resolution : study.resolution;
  POLYPOD_ASSIGN(resolution, store.note(kResolution));
  if (resolution == fmt::format("{}", known.resolution)) {
    POLYPOD_ASSIGN(kept, store.compared());
    known.rows = std::move(kept);
    keep_what_is_of(study, known.rows);
  }
  const std::size_t kept = known.rows.size(), all = study.compared.size();
  std::vector<Row> rows = answer;
  for (Row& row : rows) row.phase = Phase::refine;  // the start among them is judged as the candidate that it is
  for (std::size_t i = kept; i < all; ++i) {
    Row& row = rows.emplace_back();
    row.row = static_cast<std::int64_t>(i) + 1;
    row.varied = study.compared[i].varied;
  }
  std::vector<bool> done(rows.size(), false);
  std::size_t count = 0;
  if (progress && !rows.empty()) progress(0);
  POLYPOD_ASSIGN(whole, crew.work(rows, known.resolution, [&](std::size_t i, Evaluation e) -> Status {
    rows[i].evaluation = std::move(e);
    done[i] = true;
    if (progress) progress(static_cast<double>(++count) / static_cast<double>(rows.size()));
    if (i < answer.size()) {
      out.again->rows[i].evaluation = rows[i].evaluation;
      return {};
    }
    const auto next = [&] { return answer.size() + known.rows.size() - kept; };
    while (next() < rows.size() && done[next()]) known.rows.push_back(rows[next()]);
    POLYPOD_TRY(store.set_compared(known.rows));
    return store.set_note(kResolution, fmt::format("{}", known.resolution));
  }));
  if (!whole) return fail("WS110", "cancelled");
  if (out.again) POLYPOD_TRY(store.set_judged_again(out.again->resolution, out.again->rows));
  return out;
}

Result<Known> kept_compared(const Store& store) {
  POLYPOD_ASSIGN(rows, store.compared());
  POLYPOD_ASSIGN(resolution, store.note(kResolution));
  Known out{std::atoi(resolution.c_str()), std::move(rows)};
  keep_what_is_of(store.study(), out.rows);
  if (out.rows.size() < store.study().compared.size()) out.rows.clear();
  return out;
}

Standing standing_of(const Answer& answer, const Row& known) {
  const Study& study = answer.study;
  Standing out;
  out.outside = !as_candidate(study, known.varied);
  if (known.evaluation.state != State::done) {
    out.is = Standing::Is::no_solution;
    out.reason = known.evaluation.reason;
    return out;
  }
  if (study.wants_front()) {
    const std::vector<std::size_t> front = front_of(study, answer.rows);
    if (front.empty()) return out;
    // Certainly, so each at the bounds that speak against it.
    const auto beats = [&](const Evaluation& a, const Evaluation& b) {
      return dominates(goals_of(study, a, false), goals_of(study, b, true));
    };
    for (const std::size_t i : front) {
      const Evaluation& point = judged(answer, answer.rows[i]);
      if (beats(known.evaluation, point)) ++out.dominates;
      if (point.state != State::done || !beats(point, known.evaluation)) continue;
      if (out.dominated_by++ == 0) out.by = answer.rows[i].row;
    }
    out.is = out.dominated_by > 0 ? Standing::Is::dominated : Standing::Is::not_dominated;
    return out;
  }
  const auto best = best_of(study, answer.rows);
  if (!best) return out;
  const Evaluation& e = judged(answer, answer.rows[*best]);
  const Value &found = e.objective, &is = known.evaluation.objective;
  out.is = e.state != State::done || is.lower > found.upper ? Standing::Is::better
           : is.upper < found.lower                         ? Standing::Is::worse
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
  const auto points = [](int count) { return fmt::format("{} point{}", count, count == 1 ? "" : "s"); };
  switch (s.is) {
    case Standing::Is::no_solution:
      return "no solution: " + s.reason + outside;
    case Standing::Is::worse:
      return "worse than the best" + outside;
    case Standing::Is::alike:
      return "its bounds overlap with those of the best" + outside;
    case Standing::Is::better:
      return "better than the best that was found" + outside;
    case Standing::Is::dominated:
      return fmt::format("dominated by {} of the front, the first of them row {}{}", points(s.dominated_by), s.by,
                         outside);
    case Standing::Is::not_dominated:
      return s.dominates > 0
                 ? fmt::format("not dominated, and dominates {} of the front{}", points(s.dominates), outside)
                 : "not dominated" + outside;
    case Standing::Is::alone:
      break;
  }
  return "keeps all holds, where the search found nothing that does" + outside;
}

std::string advice(const Answer& answer, const std::vector<Row>& known) {
  bool within = false, better = false;
  for (const Row& row : known) {
    const Standing s = standing_of(answer, row);
    if (s.is != Standing::Is::better && s.is != Standing::Is::alone) continue;
    better = true;
    within = within || !s.outside;
  }
  if (!better) return {};
  return std::string("a machine that is known is better than the best that was found. ") +
         (within ? "Search longer, or with another seed" : "It is no candidate of the study: widen its ranges");
}

}  // namespace polypod::design
