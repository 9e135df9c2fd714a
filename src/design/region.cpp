// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What is nearest to the best, looked for with models of what lies about it.
#include <algorithm>
#include <cmath>

#include "models.hpp"
#include "refine.hpp"

namespace polypod::design {
namespace {

/// Half the side of a box about the best, which grows while it leads to better candidates and shrinks where it does
/// not.
class Half {
 public:
  Half(std::size_t n, double first) : is_(first), tolerated_(static_cast<int>(n) + 2) {}

  [[nodiscard]] double is() const { return is_; }
  void learn(bool better) {
    constexpr int kGrows = 2;
    constexpr double kLargest = 0.5;
    good_ = better ? good_ + 1 : 0;
    bad_ = better ? 0 : bad_ + 1;
    if (good_ >= kGrows) {
      is_ = std::min(2 * is_, kLargest);
      good_ = 0;
    } else if (bad_ >= tolerated_) {
      is_ /= 2;
      bad_ = 0;
    }
  }

 private:
  double is_;
  int tolerated_, good_ = 0, bad_ = 0;
};

/// The free parameters inside the box and the ranges, as shares of both; the others are those of the centre.
class Box {
 public:
  Box(const Shares& centre, const std::vector<std::size_t>& free, double half) : centre_(centre), free_(free) {
    for (const std::size_t i : free_) {
      least_.push_back(std::max(0.0, centre_[i] - half));
      width_.push_back(std::min(1.0, centre_[i] + half) - least_.back());
    }
  }
  [[nodiscard]] Shares at(const std::vector<double>& shares) const {
    Shares out = centre_;
    for (std::size_t k = 0; k < free_.size(); ++k)
      out[free_[k]] = std::clamp(least_[k] + shares[k] * width_[k], 0.0, 1.0);
    return out;
  }
  [[nodiscard]] std::vector<double> shares_of(const Shares& u) const {
    std::vector<double> out;
    for (std::size_t k = 0; k < free_.size(); ++k)
      out.push_back(std::clamp((u[free_[k]] - least_[k]) / width_[k], 0.0, 1.0));
    return out;
  }

 private:
  Shares centre_;
  std::vector<std::size_t> free_;
  std::vector<double> least_, width_;
};

/// The place of the largest worth in the box: of points about its centre at every scale, then up from the best of them.
Shares most_worth_in(const Box& box, const Shares& centre, Ledger& ledger, const Worth& worth) {
  constexpr int kTries = 150, kCalls = 150;
  constexpr double kMoved = 0.6, kStep = 0.1;
  const std::vector<double> middle = box.shares_of(centre);
  std::vector<Shares> at;
  for (int i = 0; i < kTries; ++i) {
    std::vector<double> shares = middle;
    const double size = std::pow(ledger.random().uniform(), 2);
    const std::size_t surely = ledger.below(shares.size());
    for (std::size_t k = 0; k < shares.size(); ++k) {
      if (k != surely && ledger.random().uniform() > kMoved) continue;
      shares[k] = std::clamp(shares[k] + size * (ledger.random().uniform() - 0.5), 0.0, 1.0);
    }
    at.push_back(box.at(shares));
  }
  Eigen::Index which = 0;
  double most = worth(at).maxCoeff(&which);
  Shares out = at[static_cast<std::size_t>(which)];
  subplex(
      box.shares_of(out), kStep, kCalls,
      [&](const std::vector<double>& shares) {
        const Shares u = box.at(shares);
        const double is = worth({u})[0];
        if (is > most) {
          most = is;
          out = u;
        }
        return is;
      },
      [] { return false; });
  return out;
}

}  // namespace

Result<bool> refine(Ledger& ledger, const std::vector<std::size_t>& free, const Refinement& how, Member& best) {
  if (free.empty()) return true;
  if (ledger.left() <= how.end || ledger.over()) return false;
  constexpr double kGrown = 1.1;  // the models' lengths are looked for again
  constexpr double kSmallest = 1e-4;
  constexpr int kIdle = 12;
  Half half(free.size(), 2 * how.step);
  Models models(ledger.study());
  double fitted = 0;
  int idle = 0;
  bool by_itself = false;
  const auto next = [&](const std::vector<Member>& in_work) -> std::optional<Shares> {
    by_itself = half.is() < kSmallest || idle >= kIdle;
    if (ledger.left() <= how.end || by_itself) return std::nullopt;
    models.look_near(best.u);
    if (static_cast<double>(ledger.rows().size()) > kGrown * fitted) {
      fitted = static_cast<double>(ledger.rows().size());
      models.learn(ledger, {}, true);
    }
    models.learn(ledger, in_work, false);
    return most_worth_in(Box(best.u, free, half.is()), best.u, ledger, expected_gain(ledger, models));
  };
  POLYPOD_TRY(ledger.ask_in_turn({kInWork, Phase::refine, next, [&](const Member& m, bool fresh) {
                                    idle = fresh ? 0 : idle + 1;
                                    half.learn(improve(ledger, best, m));
                                  }}));
  return by_itself;
}

}  // namespace polypod::design
