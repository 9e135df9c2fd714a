// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "models.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace polypod::design {
namespace {

// A model is no better for more points than this, and each step costs their cube.
constexpr std::size_t kMostPoints = 260;
// Of those about one place: as many, and so many for each parameter.
constexpr std::size_t kNearest = 15, kNearestForEach = 8;

struct Points {
  std::vector<Shares> u;
  std::vector<double> value;
  void add(const Shares& at, double is) {
    u.push_back(at);
    value.push_back(is);
  }
};

Eigen::MatrixXd as_rows(const std::vector<Shares>& u) {
  Eigen::MatrixXd out(static_cast<Eigen::Index>(u.size()), static_cast<Eigen::Index>(u.empty() ? 0 : u[0].size()));
  for (Eigen::Index i = 0; i < out.rows(); ++i)
    for (Eigen::Index k = 0; k < out.cols(); ++k)
      out(i, k) = u[static_cast<std::size_t>(i)][static_cast<std::size_t>(k)];
  return out;
}

bool fit(const Points& points, Kriging& model, bool again) {
  constexpr std::size_t kLeast = 3;
  if (points.value.size() < kLeast) return false;
  model.fit(as_rows(points.u),
            Eigen::Map<const Eigen::VectorXd>(points.value.data(), Eigen::Index(points.value.size())), again);
  return true;
}

/// Points to ask the models about: over all ranges, and about the best at every scale, some of their parameters at an
/// end of the range.
std::vector<Shares> places(Ledger& ledger, const std::vector<Shares>& best) {
  constexpr int kAnywhere = 300, kAboutEach = 50;
  constexpr double kSmallest = 0.002, kLargest = 0.4, kAtAnEnd = 0.15;
  const std::size_t n = ledger.n();
  Random& random = ledger.random();
  std::vector<Shares> out;
  for (int i = 0; i < kAnywhere; ++i) {
    Shares u(n);
    for (double& x : u) x = random.uniform();
    out.push_back(std::move(u));
  }
  for (const Shares& about : best) {
    Shares near_ends = about;
    for (std::size_t k = 0; k < n; ++k) {
      constexpr double kNearEnd = 0.05;
      if (std::abs(about[k] - 0.5) > 0.5 - kNearEnd) near_ends[k] = about[k] < 0.5 ? 0 : 1;
      for (const double end : {0.0, 1.0}) {
        out.push_back(about);
        out.back()[k] = end;
      }
    }
    out.push_back(std::move(near_ends));
    for (int i = 0; i < kAboutEach; ++i) {
      const double size = kSmallest * std::pow(kLargest / kSmallest, random.uniform());
      Shares u = about;
      const std::size_t surely = ledger.below(n);
      for (std::size_t k = 0; k < n; ++k) {
        if (k != surely && random.uniform() < 0.5) continue;
        const double end = random.uniform() < 0.5 ? 0.0 : 1.0;
        u[k] = random.uniform() < kAtAnEnd ? end : std::clamp(u[k] + size * random.normal(), 0.0, 1.0);
      }
      out.push_back(std::move(u));
    }
  }
  return out;
}

/// Steps and lists: the model is asked about what would be tried.
void snap(const Study& study, std::vector<Shares>& places) {
  for (std::size_t k = 0; k < study.vary.size(); ++k) {
    const Vary& v = study.vary[k];
    if (!v.count()) continue;
    for (Shares& u : places) u[k] = v.share_of(v.at(u[k]));
  }
}

}  // namespace

double distance(const Shares& a, const Shares& b) {
  double out = 0;
  for (std::size_t k = 0; k < a.size(); ++k) out = std::max(out, std::abs(a[k] - b[k]));
  return out;
}

double normal_below(double z) {
  return 0.5 * std::erfc(-z / std::numbers::sqrt2);
}

std::vector<double> middle_goals(const Study& study, const Evaluation& e) {
  std::vector<double> out = goals_of(study, e, false), hopeful = goals_of(study, e, true);
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i] = 0.5 * (out[i] + hopeful[i]);
    if (std::isnan(out[i])) out[i] = -std::numeric_limits<double>::infinity();
  }
  return out;
}

GoalScale::GoalScale(const Ledger& ledger) : study_(ledger.study()), by_ratio_(study_.goals.size(), true) {
  constexpr double kNone = 1e-6;  // of the largest: as good as 0
  const double none = std::numeric_limits<double>::infinity();
  std::vector<double> least(by_ratio_.size(), none), most(by_ratio_.size(), -none);
  for (const Row& row : ledger.rows()) {
    const std::vector<double> goals = middle_goals(study_, row.evaluation);
    for (std::size_t k = 0; k < goals.size(); ++k) {
      if (!std::isfinite(goals[k])) continue;
      const double value = study_.goals[k].maximise ? goals[k] : -goals[k];
      least[k] = std::min(least[k], value);
      most[k] = std::max(most[k], value);
    }
  }
  for (std::size_t k = 0; k < by_ratio_.size(); ++k) by_ratio_[k] = least[k] > kNone * std::max(most[k], 0.0);
}

std::vector<double> GoalScale::of(const Evaluation& e) const {
  std::vector<double> out = middle_goals(study_, e);
  for (std::size_t k = 0; k < out.size(); ++k)
    if (by_ratio_[k] && std::isfinite(out[k])) out[k] = out[k] > 0 ? std::log(out[k]) : -std::log(-out[k]);
  return out;
}

Models::Models(const Study& study) : study_(study), figures_(study.figures()) {
  for (const Hold& h : study.holds)
    if (!h.box) holds_.push_back(&h);
  wanted_.resize(study.wants_front() ? study.goals.size() : 1);
  kept_.resize(holds_.size() + 1);
  known_.assign(kept_.size(), false);
}

/// All candidates; of too many those that are best, and of the rest the last.
std::vector<std::size_t> Models::rows_of(const Ledger& ledger) const {
  std::vector<std::size_t> rows;
  for (std::size_t i = 0; i < ledger.rows().size(); ++i)
    if (ledger.is_candidate(ledger.rows()[i])) rows.push_back(i);
  if (!centre_.empty()) {
    const std::size_t most = kNearest + kNearestForEach * centre_.size();
    if (rows.size() <= most) return rows;
    std::vector<double> away(ledger.rows().size());
    for (const std::size_t i : rows) away[i] = distance(ledger.shares_of(ledger.rows()[i]), centre_);
    std::stable_sort(rows.begin(), rows.end(), [&](std::size_t a, std::size_t b) { return away[a] < away[b]; });
    rows.resize(most);
    std::sort(rows.begin(), rows.end());
    return rows;
  }
  if (rows.size() <= kMostPoints) return rows;
  // Of a front by how many others are better in every goal.
  std::vector<std::vector<double>> goals;
  if (study_.wants_front())
    for (const std::size_t i : rows) goals.push_back(middle_goals(study_, ledger.rows()[i].evaluation));
  std::vector<double> worth(ledger.rows().size());
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const Evaluation& e = ledger.rows()[rows[k]].evaluation;
    const bool kept = study_.wants_front() ? e.violation == 0 : e.state == State::done;
    if (!kept) {
      worth[rows[k]] = -1e6 - std::min(e.violation, 1e6);
    } else if (!study_.wants_front()) {
      worth[rows[k]] = e.objective.value;
    } else {
      worth[rows[k]] = -static_cast<double>(
          std::count_if(goals.begin(), goals.end(), [&](const auto& g) { return dominates(g, goals[k]); }));
    }
  }
  std::vector<std::size_t> best = rows;
  std::stable_sort(best.begin(), best.end(), [&](std::size_t a, std::size_t b) { return worth[a] > worth[b]; });
  best.resize(kMostPoints / 2);
  for (std::size_t k = rows.size(); best.size() < kMostPoints && k-- > 0;)
    if (std::find(best.begin(), best.end(), rows[k]) == best.end()) best.push_back(rows[k]);
  std::sort(best.begin(), best.end());
  return best;
}

void Models::learn(const Ledger& ledger, const std::vector<Member>& believed, bool again) {
  std::vector<Points> wanted(wanted_.size()), kept(kept_.size());
  bool any_other = false;
  const GoalScale scale(ledger);
  for (const std::size_t i : rows_of(ledger)) {
    const Row& row = ledger.rows()[i];
    const Shares u = ledger.shares_of(row);
    const Evaluation& e = row.evaluation;
    if (study_.wants_front()) {
      const std::vector<double> goals = scale.of(e);
      for (std::size_t k = 0; k < goals.size(); ++k)
        if (std::isfinite(goals[k])) wanted[k].add(u, goals[k]);
    } else if (std::isfinite(e.objective.value)) {
      wanted[0].add(u, std::min(e.objective.value, e.objective.upper));
    }
    bool explained = e.violation == 0;
    for (std::size_t h = 0; h < holds_.size(); ++h) {
      const double margin = margin_of(*holds_[h], e);
      if (!std::isfinite(margin)) continue;
      kept[h].add(u, margin);
      explained = explained || margin < 0;
    }
    constexpr double kKept = 0.3, kLeastBroken = 0.1;
    kept.back().add(u, explained ? kKept : -std::clamp(e.violation, kLeastBroken, 1.0));
    any_other = any_other || !explained;
  }
  if (!any_other) kept.back() = {};
  for (const Member& m : believed) {
    const Eigen::MatrixXd at = as_rows({m.u});
    for (std::size_t k = 0; k < wanted_.size() && wanted_known_; ++k) wanted[k].add(m.u, wanted_[k].at(at).mean[0]);
    for (std::size_t h = 0; h < kept_.size(); ++h)
      if (known_[h] && !kept[h].value.empty()) kept[h].add(m.u, kept_[h].at(at).mean[0]);
  }
  wanted_known_ = true;
  for (std::size_t k = 0; k < wanted_.size(); ++k) wanted_known_ = fit(wanted[k], wanted_[k], again) && wanted_known_;
  for (std::size_t h = 0; h < kept_.size(); ++h) known_[h] = fit(kept[h], kept_[h], again);
}

std::vector<Kriging::Guess> Models::wanted(const std::vector<Shares>& at) const {
  std::vector<Kriging::Guess> out;
  if (!wanted_known_) return out;
  const Eigen::MatrixXd points = as_rows(at);
  for (const Kriging& model : wanted_) out.push_back(model.at(points));
  return out;
}

Eigen::VectorXd Models::times_chance(const std::vector<Shares>& at, Eigen::VectorXd out) const {
  constexpr double kLeast = 1e-300;
  // What cannot be judged at all has no goals either, so the models of these expect much there.
  constexpr double kOfOthers = 6;
  const Eigen::MatrixXd points = as_rows(at);
  for (std::size_t h = 0; h < kept_.size(); ++h) {
    if (!known_[h]) continue;
    const double power = h + 1 == kept_.size() ? kOfOthers : 1;
    const Kriging::Guess guess = kept_[h].at(points);
    for (Eigen::Index i = 0; i < out.size(); ++i)
      out[i] += power * std::log(std::max(normal_below(guess.mean[i] / std::max(guess.deviation[i], 1e-9)), kLeast));
  }
  return out;
}

/// How far a hold is kept, as a share of its bound; NaN where its figure is not known.
double Models::margin_of(const Hold& h, const Evaluation& e) const {
  const auto at = static_cast<std::size_t>(std::find(figures_.begin(), figures_.end(), h.figure) - figures_.begin());
  if (at >= e.figures.size() || !std::isfinite(e.figures[at].value)) return std::numeric_limits<double>::quiet_NaN();
  const double value = e.figures[at].value;
  // Of a volume the bounds must keep it.
  const double unsure = h.figure == Figure::volume ? 0.5 * study_.relative_tolerance : 0.0;
  double out = 1;
  if (h.min) out = std::min(out, (value - *h.min) / std::max(std::abs(*h.min), 1e-12) - unsure);
  if (h.max) out = std::min(out, (*h.max - value) / std::max(std::abs(*h.max), 1e-12) - unsure);
  return std::max(out, -1.0);
}

Shares most_worth(Ledger& ledger, const Worth& worth, const std::vector<Shares>& about) {
  std::vector<Shares> at = places(ledger, about);
  const auto expected = [&](std::vector<Shares>& places) {
    snap(ledger.study(), places);
    return worth(places);
  };
  Eigen::Index which = 0;
  double most = expected(at).maxCoeff(&which);
  Shares out = at[static_cast<std::size_t>(which)];
  constexpr int kTries = 60;
  for (const double size : {0.05, 0.02, 0.005, 0.002}) {
    at.clear();
    for (int i = 0; i < kTries; ++i) {
      Shares u = out;
      const std::size_t surely = ledger.below(u.size());
      for (std::size_t k = 0; k < u.size(); ++k)
        if (k == surely || ledger.random().uniform() < 0.4)
          u[k] = std::clamp(u[k] + size * ledger.random().normal(), 0.0, 1.0);
      at.push_back(std::move(u));
    }
    const double here = expected(at).maxCoeff(&which);
    if (here > most) {
      most = here;
      out = at[static_cast<std::size_t>(which)];
    }
  }
  return out;
}

}  // namespace polypod::design
