// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The search of few dear candidates for one machine: each batch is where models of the objective and of the holds
// expect the most.
#include "expected.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "models.hpp"

namespace polypod::design {
namespace {

double density(double z) {
  return std::exp(-0.5 * z * z) / std::sqrt(2 * std::numbers::pi);
}

/// The logarithm of the expected improvement (Mockus 1975, Jones 1998) times the chance that all holds are kept;
/// without a candidate that keeps them, of that chance alone.
Eigen::VectorXd expected_gain(const Models& models, double best, const std::vector<Shares>& at) {
  constexpr double kLeast = 1e-300;
  Eigen::VectorXd out = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(at.size()));
  const std::vector<Kriging::Guess> wanted = models.wanted(at);
  if (!wanted.empty() && std::isfinite(best)) {
    const Kriging::Guess& guess = wanted.front();
    for (Eigen::Index i = 0; i < out.size(); ++i) {
      const double s = std::max(guess.deviation[i], 1e-12 * (1 + std::abs(best))), z = (guess.mean[i] - best) / s;
      out[i] = std::log(std::max(s * (z * normal_below(z) + density(z)), kLeast));
    }
  }
  return models.times_chance(at, std::move(out));
}

/// Of the candidates that keep all holds, as the models have them without noise: a lucky one is not taken for better
/// than those about it.
double best_objective(const Ledger& ledger, const Models& models) {
  std::vector<Shares> at;
  double out = -std::numeric_limits<double>::infinity();
  for (const Row& row : ledger.rows()) {
    if (!ledger.is_candidate(row) || row.evaluation.state != State::done) continue;
    at.push_back(ledger.shares_of(row));
    out = std::max(out, row.evaluation.objective.value);
  }
  if (at.empty()) return out;
  const std::vector<Kriging::Guess> wanted = models.wanted(at);
  return wanted.empty() ? out : wanted.front().mean.maxCoeff();
}

}  // namespace

bool takes_models(const Ledger& ledger) {
  constexpr std::int64_t kMostForModels = 600;
  constexpr std::size_t kMostParameters = 20;
  const bool few = ledger.left() <= kMostForModels && ledger.n() <= kMostParameters;
  const Search search = ledger.study().search;
  return search == Search::models || (search == Search::automatic && few);
}

Worth expected_gain(const Ledger& ledger, const Models& models) {
  const double known = best_objective(ledger, models);
  return [&models, known](const std::vector<Shares>& at) { return expected_gain(models, known, at); };
}

Status expect(Ledger& ledger, std::int64_t end, Member& best) {
  constexpr std::size_t kStarts = 6;
  constexpr double kElsewhere = 0.25;
  constexpr int kEach = 4;         // one of so many lies elsewhere: on another hill, if there is one
  constexpr double kGrown = 1.15;  // the models' lengths are looked for again
  constexpr int kIdle = 12;
  const auto wanted = static_cast<std::int64_t>(2 * ledger.n() + 6);
  std::vector<Member> all =
      ledger.latin(static_cast<std::size_t>(std::clamp((ledger.left() - end) / 3, std::int64_t{4}, wanted)), true);
  POLYPOD_TRY(ledger.ask(all, Phase::sample));
  for (const Member& m : all) improve(ledger, best, m);
  Models models(ledger.study());
  double fitted = 0;
  int asked = 0, idle = 0;
  const auto next = [&](const std::vector<Member>& in_work) -> std::optional<Shares> {
    if (ledger.left() <= end || idle >= kIdle) return std::nullopt;
    std::stable_sort(all.begin(), all.end(),
                     [&](const Member& a, const Member& b) { return rank(ledger, a) > rank(ledger, b); });
    std::vector<Shares> about;
    for (std::size_t i = 0; i < std::min(kStarts, all.size()); ++i) about.push_back(all[i].u);
    if (static_cast<double>(ledger.rows().size()) > kGrown * fitted) {
      fitted = static_cast<double>(ledger.rows().size());
      models.learn(ledger, {}, true);
    }
    models.learn(ledger, in_work, false);
    const double away = ++asked % kEach == 0 ? kElsewhere : 0;
    const Worth gain = expected_gain(ledger, models), worth = [&](const std::vector<Shares>&at) {
      Eigen::VectorXd out = gain(at);
      for (std::size_t i = 0; away > 0 && i < at.size(); ++i)
        if (distance(at[i], about.front()) < away) out[Eigen::Index(i)] = -std::numeric_limits<double>::infinity();
      return out;
    };
    return most_worth(ledger, worth, about);
  };
  return ledger.ask_in_turn({kInWork, Phase::search, next, [&](const Member& m, bool fresh) {
                               idle = fresh ? 0 : idle + 1;
                               improve(ledger, best, m);
                               all.push_back(m);
                             }});
}

}  // namespace polypod::design
