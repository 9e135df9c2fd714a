// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The search of few dear candidates, and the order of candidates.
#pragma once

#include <limits>

#include "ledger.hpp"

namespace polypod::design {

/// The number by which candidates are ordered: those that keep all holds by their objective, the others below them by
/// how much they break.
struct Rank {
  double violation = std::numeric_limits<double>::infinity(), objective = -std::numeric_limits<double>::infinity();
  bool operator>(const Rank& other) const {
    if (violation != other.violation) return violation < other.violation;
    return objective > other.objective;
  }
};
inline Rank rank(const Ledger& ledger, const Member& m) {
  const Evaluation& e = ledger.of(m);
  return {e.violation, std::isnan(e.objective.value) ? -std::numeric_limits<double>::infinity() : e.objective.value};
}
/// `best` becomes `m` where that is better, or where there was none.
inline bool improve(const Ledger& ledger, Member& best, const Member& m) {
  if (m.u.empty() || (!best.u.empty() && !(rank(ledger, m) > rank(ledger, best)))) return false;
  best = m;
  return true;
}

/// Candidates that are computed at a time, where each follows from those that are known: more occupy more ranks, and
/// each knows less.
constexpr std::size_t kInWork = 5;

/// Bayesian optimisation with Kriging models of the objective and of each hold: a sample over all ranges, then
/// candidates where the improvement times the chance of keeping all holds is expected to be largest, until `end`
/// evaluations are left or nothing new is found. The rows decide it, and the seed: not the number of threads.
Status expect(Ledger& ledger, std::int64_t end, Member& best);

/// What is nearest to `best` in the parameters `free`: models of the candidates about it say where in a box the most is
/// expected; the box, at first two steps to each side, grows with what it finds and shrinks without (Eriksson et al.
/// 2019). Whether it ended by itself, with a box too small to matter.
struct Refinement {
  std::int64_t end = 0;  ///< evaluations that stay
  double step = 0;       ///< as a share of the ranges
};
Result<bool> refine(Ledger& ledger, const std::vector<std::size_t>& free, const Refinement& how, Member& best);

/// The same for a front, with a model of each goal: a candidate is where the front is expected to be pushed out the
/// most along a direction that is drawn for it. Everything that was asked for, until no evaluation is left or nothing
/// new is found.
Result<std::vector<Member>> expect_front(Ledger& ledger);

/// Models of what is known pay where an evaluation is dearer than a step of theirs, and there are few.
bool takes_models(const Ledger& ledger);

}  // namespace polypod::design
