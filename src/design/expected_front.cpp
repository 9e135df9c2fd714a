// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The search of few dear candidates for a front: each candidate is where models of the goals expect to push the front
// out the most in one direction, and each direction is drawn anew.
#include <algorithm>
#include <cmath>
#include <optional>

#include "models.hpp"

namespace polypod::design {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();

/// Where the front is to be pushed out: between the goals, or towards the best of one of them, an end of the front.
struct Direction {
  std::vector<double> of;  ///< a unit vector of the positive space
  std::optional<std::size_t> end;
};
Direction draw_direction(Ledger& ledger) {
  constexpr double kAnEnd = 0.1, kLeast = 0.03;
  const std::size_t n = ledger.study().goals.size();
  Direction out;
  double square = 0;
  for (std::size_t k = 0; k < n; ++k) {
    out.of.push_back(std::abs(ledger.random().normal()));
    square += out.of[k] * out.of[k];
  }
  for (double& x : out.of) x = std::max(x / std::sqrt(square), kLeast);
  if (ledger.random().uniform() < kAnEnd) out.end = ledger.below(n);
  return out;
}

/// The front as it is known, in shares of its own extent: 0 a little below its worst goals, about 1 at its best.
class Frame {
 public:
  explicit Frame(const Ledger& ledger) : scale_(ledger) {
    std::vector<std::vector<double>> all;
    for (const Row& row : ledger.rows()) {
      if (!ledger.is_candidate(row) || row.evaluation.violation != 0) continue;
      std::vector<double> g = scale_.of(row.evaluation);
      if (std::all_of(g.begin(), g.end(), [](double x) { return std::isfinite(x); })) all.push_back(std::move(g));
    }
    std::copy_if(all.begin(), all.end(), std::back_inserter(front_), [&](const auto& g) {
      return std::none_of(all.begin(), all.end(), [&](const auto& other) { return dominates(other, g); });
    });
    for (std::size_t k = 0; !front_.empty() && k < front_[0].size(); ++k) {
      const auto [least, most] = ends(front_, k);
      const auto [worst, best] = ends(all, k);
      constexpr double kBelow = 0.1, kOfAll = 0.05;  // a front of few points has hardly an extent
      const double extent = std::max({most - least, kOfAll * (best - worst), 1e-12 * (1 + std::abs(most))});
      base_.push_back(least - kBelow * extent);
      extent_.push_back(extent);
    }
  }
  [[nodiscard]] bool empty() const { return front_.empty(); }
  /// What is being computed is taken for what the models expect of it, so that the next candidate lies elsewhere.
  void believe(const Models& models, const std::vector<Member>& in_work) {
    for (const Member& m : in_work) {
      const std::vector<Kriging::Guess> wanted = models.wanted({m.u});
      if (wanted.empty() || empty()) return;
      std::vector<double>& g = front_.emplace_back();
      for (const Kriging::Guess& guess : wanted) g.push_back(guess.mean[0]);
    }
  }
  [[nodiscard]] double reach(const Evaluation& e, const Direction& to) const {
    return empty() ? -kInf : reach(scale_.of(e), to);
  }
  /// How far a point reaches: min_k share_k / direction_k; at an end the share of its goal, and little of the others.
  [[nodiscard]] double reach(const std::vector<double>& goals, const Direction& to) const {
    constexpr double kOfOthers = 0.02;
    double out = to.end ? (1 - kOfOthers) * share(*to.end, goals[*to.end]) : kInf;
    for (std::size_t k = 0; k < goals.size(); ++k) {
      if (to.end) {
        out += kOfOthers * share(k, goals[k]);
      } else {
        out = std::min(out, share(k, goals[k]) / to.of[k]);
      }
    }
    return out;
  }
  [[nodiscard]] double reach(const Direction& to) const {
    double out = -kInf;
    for (const auto& g : front_) out = std::max(out, reach(g, to));
    return out;
  }

 private:
  static std::pair<double, double> ends(const std::vector<std::vector<double>>& points, std::size_t goal) {
    double least = kInf, most = -kInf;
    for (const auto& g : points) {
      least = std::min(least, g[goal]);
      most = std::max(most, g[goal]);
    }
    return {least, most};
  }
  [[nodiscard]] double share(std::size_t goal, double value) const { return (value - base_[goal]) / extent_[goal]; }

  GoalScale scale_;
  std::vector<std::vector<double>> front_;
  std::vector<double> base_, extent_;
};

/// The logarithm of by how much a candidate is expected to reach farther than the front along a direction, times the
/// chance that all holds are kept. Over all directions the reach to the power of the number of goals is the
/// hypervolume (Zhang and Golovin 2020). The expectation is over fixed draws of the goals, which the models take as
/// independent.
class Push {
 public:
  Push(Ledger& ledger, const Models& models, const Frame& frame)
      : models_(models), frame_(frame), direction_(draw_direction(ledger)), known_(frame.reach(direction_)) {
    constexpr Eigen::Index kDraws = 48;
    draws_.resize(static_cast<Eigen::Index>(direction_.of.size()), kDraws);
    for (double& x : draws_.reshaped()) x = ledger.random().normal();
  }
  [[nodiscard]] const Direction& direction() const { return direction_; }

  Eigen::VectorXd operator()(const std::vector<Shares>& at) const {
    Eigen::VectorXd out = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(at.size()));
    const std::vector<Kriging::Guess> wanted = models_.wanted(at);
    if (!wanted.empty() && !frame_.empty()) {
      for (Eigen::Index i = 0; i < out.size(); ++i) out[i] = gain(wanted, i);
    }
    return models_.times_chance(at, std::move(out));
  }

 private:
  [[nodiscard]] double gain(const std::vector<Kriging::Guess>& wanted, Eigen::Index i) const {
    constexpr double kLeast = 1e-300;
    double sum = 0;
    std::vector<double> goals(wanted.size());
    for (std::size_t k = 0; k < goals.size(); ++k) goals[k] = wanted[k].mean[i];
    const double middle = frame_.reach(goals, direction_);
    for (Eigen::Index d = 0; d < draws_.cols(); ++d) {
      for (std::size_t k = 0; k < goals.size(); ++k)
        goals[k] = wanted[k].mean[i] + wanted[k].deviation[i] * draws_(Eigen::Index(k), d);
      sum += std::max(0.0, frame_.reach(goals, direction_) - known_);
    }
    // Where no draw goes farther, the nearer the better.
    if (sum > 0) return std::log(std::max(sum / static_cast<double>(draws_.cols()), kLeast));
    return std::log(kLeast) + std::min(0.0, middle - known_);
  }

  const Models& models_;
  const Frame& frame_;
  Direction direction_;
  double known_;
  Eigen::MatrixXd draws_;
};

}  // namespace

Result<std::vector<Member>> expect_front(Ledger& ledger) {
  constexpr std::size_t kStarts = 6;
  constexpr double kGrown = 1.15;  // the models' lengths are looked for again
  constexpr int kIdle = 12;
  constexpr std::size_t kTrialsInWork = 4;  // with five the front of three goals has less volume
  const auto wanted = static_cast<std::int64_t>(2 * ledger.n() + 6);
  std::vector<Member> all =
      ledger.latin(static_cast<std::size_t>(std::clamp(ledger.left() / 3, std::int64_t{4}, wanted)), true);
  POLYPOD_TRY(ledger.ask(all, Phase::sample));
  Models models(ledger.study());
  double fitted = 0;
  int idle = 0;
  const auto next = [&](const std::vector<Member>& in_work) -> std::optional<Shares> {
    if (idle >= kIdle) return std::nullopt;
    Frame frame(ledger);
    if (static_cast<double>(ledger.rows().size()) > kGrown * fitted) {
      fitted = static_cast<double>(ledger.rows().size());
      models.learn(ledger, {}, true);
    }
    models.learn(ledger, in_work, false);
    frame.believe(models, in_work);
    const Push push(ledger, models, frame);
    std::stable_sort(all.begin(), all.end(), [&](const Member& a, const Member& b) {
      const auto worth = [&](const Member& m) {
        const Evaluation& e = ledger.of(m);
        return Rank{e.violation, frame.reach(e, push.direction())};
      };
      return worth(a) > worth(b);
    });
    std::vector<Shares> about;
    for (std::size_t i = 0; i < std::min(kStarts, all.size()); ++i) about.push_back(all[i].u);
    return most_worth(ledger, push, about);
  };
  POLYPOD_TRY(ledger.ask_in_turn({kTrialsInWork, Phase::search, next, [&](const Member& m, bool fresh) {
                                    idle = fresh ? 0 : idle + 1;
                                    all.push_back(m);
                                  }}));
  return all;
}

}  // namespace polypod::design
