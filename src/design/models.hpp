// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the rows of a search let expect of candidates that were not judged, and where such candidates are looked for.
#pragma once

#include <functional>

#include "expected.hpp"
#include "surrogate.hpp"

namespace polypod::design {

/// Kriging models of what is wanted (the objective, or of a front each goal, so that more is better) and of how far
/// each hold is kept (as a share of its bound, negative: broken). Holds that are no bound on a figure have one model
/// together.
class Models {
 public:
  explicit Models(const Study& study);

  /// From the rows, and from `believed`, candidates that are asked for already: these count as what is expected of
  /// them, so that the next one lies elsewhere. `again`: lengths of the models are looked for anew.
  void learn(const Ledger& ledger, const std::vector<Member>& believed, bool again);
  /// From now on only the rows nearest to `centre` are learned.
  void look_near(const Shares& centre) { centre_ = centre; }
  /// Of each thing that is wanted; empty before there are enough rows.
  [[nodiscard]] std::vector<Kriging::Guess> wanted(const std::vector<Shares>& at) const;
  /// A logarithm, one a place, and that of the chance that all holds are kept there (Schonlau 1997); the chance that a
  /// machine can be judged at all counts to the sixth power.
  [[nodiscard]] Eigen::VectorXd times_chance(const std::vector<Shares>& at, Eigen::VectorXd out) const;

 private:
  [[nodiscard]] double margin_of(const Hold& h, const Evaluation& e) const;
  [[nodiscard]] std::vector<std::size_t> rows_of(const Ledger& ledger) const;

  const Study& study_;
  std::vector<Figure> figures_;
  Shares centre_;
  std::vector<const Hold*> holds_;
  std::vector<Kriging> wanted_, kept_;
  std::vector<bool> known_;  // of kept_
  bool wanted_known_ = false;
};

/// The largest difference of a parameter.
double distance(const Shares& a, const Shares& b);
/// The chance that a standard normal number is below z.
double normal_below(double z);

/// The goals of an evaluation between their bounds, so that more is better; -infinity where one is not known.
std::vector<double> middle_goals(const Study& study, const Evaluation& e);

/// The goals as they count in a search for a front. Of figures that are above 0 in all rows ratios count, as in JEL
/// (8.2) and (8.3): their logarithms. A condition number of 3 instead of 2 is as much as one of 300 instead of 200.
class GoalScale {
 public:
  explicit GoalScale(const Ledger& ledger);
  /// More is better; -infinity where one is not known.
  [[nodiscard]] std::vector<double> of(const Evaluation& e) const;

 private:
  const Study& study_;
  std::vector<bool> by_ratio_;
};

/// The larger the better, of each of these places.
using Worth = std::function<Eigen::VectorXd(const std::vector<Shares>&)>;
/// The expected improvement of the best candidate times the chance of keeping all holds; a logarithm.
Worth expected_gain(const Ledger& ledger, const Models& models);
/// The place of the largest worth: over all ranges and about each of `about` at every scale, then refined in some
/// rounds. Steps and lists are kept.
Shares most_worth(Ledger& ledger, const Worth& worth, const std::vector<Shares>& about);

}  // namespace polypod::design
