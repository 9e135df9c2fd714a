// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The search for the best machine of a study, or for its front.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "polypod/design/crew.hpp"
#include "polypod/design/store.hpp"

namespace polypod::design {

/// What a long search reports after each evaluation.
struct SearchProgress {
  int evaluations = 0, most = 0;
  Phase phase = Phase::sample;
  double objective = 0;     ///< the best so far; NaN where there is none, and of a front
  int front = 0;            ///< points of the front so far
  double seconds_left = 0;  ///< by the mean of the evaluations that this run computed; NaN before the first
};

struct OptimizeOptions {
  int threads = 0;       ///< 0: as many as the machine has. The result does not depend on it.
  Crew* crew = nullptr;  ///< that computes; none: `threads` threads of this process
  std::string version;
  std::function<bool()> cancelled;
  std::function<void(const SearchProgress&)> progress;
  /// When a row became the best of all that the store has.
  std::function<Status(const Row&)> better;
};

/// How one start of the search for one machine ended: a sample over all ranges, evolution, and what is nearest to its
/// best.
struct Start {
  int evaluations = 0;     ///< that it asked first; what an earlier one had asked costs none
  std::int64_t row = 0;    ///< Row::row of the best that it met, which an earlier start may have met first
  bool by_itself = false;  ///< its box fell below 1e-4 of the ranges; false: its share of the evaluations was used up
};

struct Outcome {
  /// Those of this search in its order; behind them what the store has besides, of a search with another budget.
  std::vector<Row> rows;
  std::size_t asked = 0;            ///< rows of this search
  std::optional<std::size_t> best;  ///< of all rows
  std::vector<std::size_t> front;   ///< of all rows
  std::int64_t computed = 0;        ///< by this run; the others were in the store
  bool complete = false;            ///< the search ended by itself
  std::vector<Start> starts;        ///< of the search for one machine, in their order
};

/// Looks for the machine with the largest objective that keeps all holds, or for the front of the goals.
///
/// Few evaluations (up to 600, of at most 20 parameters) or Search::models: a Latin hypercube, then candidates where
/// Kriging models of what is wanted and of the holds expect the most (Jones 1998; of a front along drawn directions,
/// Zhang and Golovin 2020), of one objective then what is nearest to the best, as below.
///
/// Many evaluations or Search::evolution, one objective: a Latin hypercube, then differential evolution
/// (current-to-pbest/1 with success-history adaptation and a shrinking population: Tanabe and Fukunaga 2014), a
/// parameter beyond its range set to its end. Then from the best: neighbouring steps, the ends of each range, and a
/// trust region with models of what lies about it (Eriksson et al. 2019). That is one start; up to five of them, each
/// with a sample of its own, share four fifths of the evaluations, and the best goes on with the rest (50 evaluations a
/// start and 3 for each parameter are the least). What is left then goes to further starts. A front: NSGA-II (Deb
/// 2002).
///
/// A candidate that keeps all holds is better than one that does not, of two that do not the one that breaks them less
/// (Deb 2000). Where all parameters have steps or lists and all combinations fit into the evaluations, all are tried
/// instead. The first member of the first sample is the start, moved into the ranges.
///
/// No claim is made that no better machine exists. A candidate, and the incumbents that it is compared with, follow
/// from all rows but the last few, a number that does not depend on that of the threads, whatever is done of those; so
/// the same study gives the same rows. A run that was broken off is repeated from the rows of the store, which are
/// taken as they are, until the first that is not there. Errors: those of the store; WS110 is none: the outcome is not
/// complete then.
Result<Outcome> optimize(const Study& study, Store& store, const OptimizeOptions& options);

/// The starts of the last search that the store has; none where it was broken off. Errors: those of the store.
Result<std::vector<Start>> kept_starts(const Store& store);
/// How the starts ended, in one line. The rows must hold theirs.
std::string in_words(const std::vector<Start>& starts, const std::vector<Row>& rows);

/// Rows judged again over a survey with twice as many points a side (512 at most): a search finds machines that the
/// points of its own survey flatter (judge_finer).
struct JudgedAgain {
  int resolution = 0;
  std::vector<Row> rows;  ///< with their numbers in the study and what the finer survey says of them
  /// Whether each of them keeps all holds.
  [[nodiscard]] bool holds_kept() const;
};
/// What the store has of it; none since a search went on. Errors: those of the store.
Result<std::optional<JudgedAgain>> kept_again(const Store& store);

/// These values of the varied keys as the search would try them; none where they lie outside of the ranges or beside
/// the steps and lists.
std::optional<std::vector<double>> as_candidate(const Study& study, const std::vector<double>& values);
/// Whether the machine of the study is one of its candidates: within the ranges, with all ties.
bool start_is_candidate(const Study& study);
/// Why it may be none, in words.
inline constexpr const char* kNoCandidate = "outside of the ranges, beside their steps, or not as the ties have it";

/// The row with the largest objective of those that are done; of equal ones the first. Nothing of a front.
std::optional<std::size_t> best_of(const Study& study, const std::vector<Row>& rows);

/// Rows that are done and that no other done row is better than in one goal and at least as good as in all, the best in
/// the first goal first; of equal ones the first. Cost: rows times points of the front.
std::vector<std::size_t> front_of(const Study& study, const std::vector<Row>& rows);

}  // namespace polypod::design
