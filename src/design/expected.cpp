// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The search of few dear candidates: each batch is where models of the objective and of the holds expect the most.
#include "expected.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "surrogate.hpp"

namespace polypod::design {
namespace {

// A model is no better for more points than this, and each step costs their cube.
constexpr std::size_t kMostPoints = 260;

double density(double z) {
  return std::exp(-0.5 * z * z) / std::sqrt(2 * std::numbers::pi);
}
double below(double z) {
  return 0.5 * std::erfc(-z / std::numbers::sqrt2);
}

/// What the rows say: the objective, and of each hold how far it is kept (as a share of its bound, negative: broken).
/// Holds that are no bound on a figure have one line together.
class Models {
 public:
  explicit Models(const Study& study) : study_(study), figures_(study.figures()) {
    for (const Hold& h : study.holds)
      if (!h.box) holds_.push_back(&h);
    kept_.resize(holds_.size() + 1);
  }

  void learn(const Ledger& ledger, const std::vector<Member>& believed, bool again) {
    std::vector<std::size_t> rows;
    for (std::size_t i = 0; i < ledger.rows().size(); ++i)
      if (ledger.is_candidate(ledger.rows()[i])) rows.push_back(i);
    if (rows.size() > kMostPoints) {  // the best, and of the rest the last
      std::vector<std::size_t> best = rows;
      std::stable_sort(best.begin(), best.end(),
                       [&](std::size_t a, std::size_t b) { return worth(ledger.rows()[a]) > worth(ledger.rows()[b]); });
      best.resize(kMostPoints / 2);
      for (std::size_t k = rows.size(); best.size() < kMostPoints && k-- > 0;)
        if (std::find(best.begin(), best.end(), rows[k]) == best.end()) best.push_back(rows[k]);
      std::sort(best.begin(), best.end());
      rows = std::move(best);
    }
    best_ = -std::numeric_limits<double>::infinity();
    Points objective;
    std::vector<Points> kept(kept_.size());
    bool any_other = false;
    for (const std::size_t i : rows) {
      const Row& row = ledger.rows()[i];
      const Shares u = ledger.shares_of(row);
      const Evaluation& e = row.evaluation;
      if (e.state == State::done) best_ = std::max(best_, e.objective.value);
      if (std::isfinite(e.objective.value)) objective.add(u, std::min(e.objective.value, e.objective.upper));
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
    // Candidates of the batch at hand count as what is expected of them, so that the next one lies elsewhere.
    for (const Member& m : believed) {
      const Eigen::MatrixXd at = as_rows({m.u});
      if (objective_known_) objective.add(m.u, objective_.at(at).mean[0]);
      for (std::size_t h = 0; h < kept_.size(); ++h)
        if (known_[h] && !kept[h].value.empty()) kept[h].add(m.u, kept_[h].at(at).mean[0]);
    }
    objective_known_ = fit(objective, objective_, again);
    known_.resize(kept_.size());
    for (std::size_t h = 0; h < kept_.size(); ++h) known_[h] = fit(kept[h], kept_[h], again);
  }

  /// The logarithm of the expected improvement (Mockus 1975, Jones 1998) times the chance that all holds are kept
  /// (Schonlau 1997); without a candidate that keeps them, of that chance alone.
  [[nodiscard]] Eigen::VectorXd expected(const std::vector<Shares>& at) const {
    constexpr double kLeast = 1e-300;
    const Eigen::MatrixXd points = as_rows(at);
    Eigen::VectorXd out = Eigen::VectorXd::Zero(points.rows());
    if (objective_known_ && std::isfinite(best_)) {
      const Kriging::Guess guess = objective_.at(points);
      for (Eigen::Index i = 0; i < out.size(); ++i) {
        const double s = std::max(guess.deviation[i], 1e-12 * (1 + std::abs(best_))), z = (guess.mean[i] - best_) / s;
        out[i] = std::log(std::max(s * (z * below(z) + density(z)), kLeast));
      }
    }
    for (std::size_t h = 0; h < kept_.size(); ++h) {
      if (!known_[h]) continue;
      const Kriging::Guess guess = kept_[h].at(points);
      for (Eigen::Index i = 0; i < out.size(); ++i)
        out[i] += std::log(std::max(below(guess.mean[i] / std::max(guess.deviation[i], 1e-9)), kLeast));
    }
    return out;
  }

 private:
  struct Points {
    std::vector<Shares> u;
    std::vector<double> value;
    void add(const Shares& at, double is) {
      u.push_back(at);
      value.push_back(is);
    }
  };

  static double worth(const Row& row) {
    const Evaluation& e = row.evaluation;
    return e.state == State::done ? e.objective.value : -1e6 - std::min(e.violation, 1e6);
  }

  static Eigen::MatrixXd as_rows(const std::vector<Shares>& u) {
    Eigen::MatrixXd out(static_cast<Eigen::Index>(u.size()), static_cast<Eigen::Index>(u.empty() ? 0 : u[0].size()));
    for (Eigen::Index i = 0; i < out.rows(); ++i)
      for (Eigen::Index k = 0; k < out.cols(); ++k)
        out(i, k) = u[static_cast<std::size_t>(i)][static_cast<std::size_t>(k)];
    return out;
  }

  static bool fit(const Points& points, Kriging& model, bool again) {
    constexpr std::size_t kLeast = 3;
    if (points.value.size() < kLeast) return false;
    model.fit(as_rows(points.u),
              Eigen::Map<const Eigen::VectorXd>(points.value.data(), Eigen::Index(points.value.size())), again);
    return true;
  }

  /// How far a hold is kept, as a share of its bound; NaN where its figure is not known.
  [[nodiscard]] double margin_of(const Hold& h, const Evaluation& e) const {
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

  const Study& study_;
  std::vector<Figure> figures_;
  std::vector<const Hold*> holds_;
  Kriging objective_;
  std::vector<Kriging> kept_;
  bool objective_known_ = false;
  std::vector<bool> known_ = std::vector<bool>(1, false);
  double best_ = 0;
};

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

double distance(const Shares& a, const Shares& b) {
  double out = 0;
  for (std::size_t k = 0; k < a.size(); ++k) out = std::max(out, std::abs(a[k] - b[k]));
  return out;
}

/// The place where most is expected, refined in some rounds; farther than `away` from the first of the best in some
/// parameter.
Shares most_expected(Ledger& ledger, const Models& models, const std::vector<Shares>& best, double away) {
  std::vector<Shares> at = places(ledger, best);
  const auto expected = [&](std::vector<Shares>& places) {
    snap(ledger.study(), places);
    Eigen::VectorXd out = models.expected(places);
    for (std::size_t i = 0; away > 0 && i < places.size(); ++i)
      if (distance(places[i], best.front()) < away) out[Eigen::Index(i)] = -std::numeric_limits<double>::infinity();
    return out;
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

}  // namespace

Status expect(Ledger& ledger, std::int64_t end, Member& best) {
  constexpr std::size_t kBatch = 4, kStarts = 6;
  constexpr double kElsewhere = 0.25;
  constexpr double kGrown = 1.15;  // the models' lengths are looked for again
  constexpr int kIdle = 3;
  const auto wanted = static_cast<std::int64_t>(2 * ledger.n() + 6);
  std::vector<Member> sample =
      ledger.latin(static_cast<std::size_t>(std::clamp((ledger.left() - end) / 3, std::int64_t{4}, wanted)), true);
  POLYPOD_TRY(ledger.ask(sample, Phase::sample));
  std::vector<Member> all = sample;
  for (const Member& m : sample) improve(ledger, best, m);
  Models models(ledger.study());
  double fitted = 0;
  int idle = 0;
  while (!ledger.over() && ledger.left() > end && idle < kIdle) {
    std::stable_sort(all.begin(), all.end(),
                     [&](const Member& a, const Member& b) { return rank(ledger, a) > rank(ledger, b); });
    std::vector<Shares> about;
    for (std::size_t i = 0; i < std::min(kStarts, all.size()); ++i) about.push_back(all[i].u);
    std::vector<Member> batch;
    const auto size = std::min<std::size_t>(kBatch, static_cast<std::size_t>(ledger.left() - end));
    while (batch.size() < size) {
      const bool again = batch.empty() && static_cast<double>(ledger.rows().size()) > kGrown * fitted;
      if (again) fitted = static_cast<double>(ledger.rows().size());
      models.learn(ledger, batch, again);
      // The last of a batch lies elsewhere: on another hill, if there is one.
      const bool elsewhere = batch.size() + 1 == kBatch;
      batch.push_back({most_expected(ledger, models, about, elsewhere ? kElsewhere : 0), 0});
    }
    const std::size_t rows_before = ledger.rows().size();
    POLYPOD_TRY(ledger.ask(batch, Phase::search));
    idle = ledger.rows().size() == rows_before ? idle + 1 : 0;
    for (const Member& m : batch) improve(ledger, best, m);
    all.insert(all.end(), batch.begin(), batch.end());
  }
  return {};
}

}  // namespace polypod::design
