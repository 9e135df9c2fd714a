// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The search for one machine: evolution over all ranges, then what is nearest to the best.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "ledger.hpp"
#include "refine.hpp"

namespace polypod::design {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();

/// The number by which candidates are ordered: those that keep all holds by their objective, the others below them by
/// how much they break.
struct Rank {
  double violation = kInf, objective = -kInf;
  bool operator>(const Rank& other) const {
    if (violation != other.violation) return violation < other.violation;
    return objective > other.objective;
  }
};

Rank rank(const Ledger& ledger, const Member& m) {
  const Evaluation& e = ledger.of(m);
  return {e.violation, std::isnan(e.objective.value) ? -kInf : e.objective.value};
}

/// Factors and shares of crossing that led to better candidates.
class Memory {
 public:
  /// CR and F for one trial.
  std::pair<double, double> draw(Ledger& ledger) const {
    const std::size_t r = ledger.below(kSize);
    const double CR = std::clamp(CR_[r] + 0.1 * ledger.random().normal(), 0.0, 1.0);
    double F = 0;
    while (F <= 0) F = F_[r] + 0.1 * std::tan(std::numbers::pi * (ledger.random().uniform() - 0.5));
    return {CR, std::min(F, 1.0)};
  }
  void add(double gain, double CR, double F) {
    sum_ += gain;
    sum_F_ += gain * F;
    sum_F2_ += gain * F * F;
    sum_CR_ += gain * CR;
    sum_CR2_ += gain * CR * CR;
  }
  /// At the end of a generation.
  void keep() {
    if (sum_ > 0) {
      F_[slot_] = sum_F2_ / sum_F_;
      CR_[slot_] = sum_CR_ > 0 ? sum_CR2_ / sum_CR_ : 0;
      slot_ = (slot_ + 1) % kSize;
    }
    sum_ = sum_F_ = sum_F2_ = sum_CR_ = sum_CR2_ = 0;
  }

 private:
  static constexpr std::size_t kSize = 5;
  std::vector<double> F_ = std::vector<double>(kSize, 0.5), CR_ = std::vector<double>(kSize, 0.8);
  std::size_t slot_ = 0;
  double sum_ = 0, sum_F_ = 0, sum_F2_ = 0, sum_CR_ = 0, sum_CR2_ = 0;
};

Shares trial(Ledger& ledger, const std::vector<Member>& population, const std::vector<Shares>& archive, std::size_t i,
             double F, double CR) {
  constexpr double kBestShare = 0.15;
  const std::size_t n = population.size();
  const auto best =
      std::max<std::size_t>(2, static_cast<std::size_t>(std::lround(kBestShare * static_cast<double>(n))));
  const Shares& p = population[ledger.below(best)].u;
  std::size_t a = i;
  while (a == i) a = ledger.below(n);
  std::size_t b = i;
  while (b == i || b == a) b = ledger.below(n + archive.size());
  const Shares& x = population[i].u;
  const Shares& x_b = b < n ? population[b].u : archive[b - n];
  Shares out = x;
  const std::size_t surely = ledger.below(ledger.n());
  for (std::size_t k = 0; k < ledger.n(); ++k) {
    if (ledger.random().uniform() >= CR && k != surely) continue;
    out[k] = std::clamp(x[k] + F * (p[k] - x[k]) + F * (population[a].u[k] - x_b[k]), 0.0, 1.0);
  }
  return out;
}

/// Better trials take the places of their parents, which go into the archive.
void select(const Ledger& ledger, std::vector<Member>& population, const std::vector<Member>& trials,
            const std::vector<std::pair<double, double>>& used, std::vector<Shares>& archive, Memory& memory) {
  for (std::size_t i = 0; i < trials.size(); ++i) {
    if (trials[i].u.empty()) continue;  // beyond the last evaluation
    const Rank now = rank(ledger, trials[i]), was = rank(ledger, population[i]);
    if (was > now) continue;
    if (now > was) {
      archive.push_back(population[i].u);
      const double gain = now.objective - was.objective;
      constexpr double kSomeGain = 1e-6;
      memory.add(std::isfinite(gain) && gain > 0 ? gain : kSomeGain, used[i].first, used[i].second);
    }
    population[i] = trials[i];
  }
  memory.keep();
}

Status evolve(Ledger& ledger, std::int64_t budget, bool first) {
  const std::int64_t end = ledger.left() - budget;  // evaluations that stay
  const auto most = static_cast<std::int64_t>(8 * ledger.n() + 8);
  const auto start_size = static_cast<std::size_t>(std::clamp(budget / 6, std::int64_t{6}, most));
  std::vector<Member> population = ledger.latin(start_size, first);
  if (!first && ledger.best()) population[0].u = ledger.best_shares();  // it takes part
  POLYPOD_TRY(ledger.ask(population, Phase::sample));
  constexpr std::size_t kLeast = 5;
  Memory memory;
  std::vector<Shares> archive;
  int idle = 0;
  constexpr int kIdle = 30;  // generations without a new candidate
  while (!ledger.over() && ledger.left() > end && population.size() >= 4 && idle < kIdle) {
    std::stable_sort(population.begin(), population.end(),
                     [&](const Member& a, const Member& b) { return rank(ledger, a) > rank(ledger, b); });
    const double done =
        1 - static_cast<double>(ledger.left() - end) / static_cast<double>(std::max<std::int64_t>(budget, 1));
    const auto size = static_cast<std::size_t>(std::lround(
        static_cast<double>(start_size) - done * static_cast<double>(start_size - std::min(start_size, kLeast))));
    if (population.size() > std::max(size, kLeast)) population.resize(std::max(size, kLeast));
    std::vector<Member> trials;
    std::vector<std::pair<double, double>> used;
    for (std::size_t i = 0; i < population.size(); ++i) {
      used.push_back(memory.draw(ledger));
      trials.push_back({trial(ledger, population, archive, i, used.back().second, used.back().first), 0});
    }
    const std::size_t rows_before = ledger.rows().size();
    POLYPOD_TRY(ledger.ask_in_place(trials, Phase::search));
    idle = ledger.rows().size() == rows_before ? idle + 1 : 0;
    select(ledger, population, trials, used, archive, memory);
    while (archive.size() > start_size)
      archive.erase(archive.begin() + static_cast<std::ptrdiff_t>(ledger.below(archive.size())));
  }
  return {};
}

std::vector<std::size_t> without_steps(const Study& study) {
  std::vector<std::size_t> out;
  for (std::size_t i = 0; i < study.vary.size(); ++i)
    if (!study.vary[i].count()) out.push_back(i);
  return out;
}

/// Neighbours of the best in what has steps or a list, until none is better.
Status climb(Ledger& ledger) {
  while (!ledger.over()) {
    const Shares u = ledger.best_shares();
    std::vector<Member> around;
    for (std::size_t i = 0; i < ledger.n(); ++i) {
      const Vary& v = ledger.study().vary[i];
      const auto count = v.count();
      if (!count || *count < 2) continue;
      const double each = v.values.empty() ? 1.0 / static_cast<double>(*count - 1) : 1.0 / static_cast<double>(*count);
      for (const double sign : {-1.0, 1.0}) {
        Member m{u, 0};
        m.u[i] += sign * each;
        if (m.u[i] > -1e-9 && m.u[i] < 1 + 1e-9) around.push_back(std::move(m));
      }
    }
    if (around.empty()) return {};
    const std::size_t before = *ledger.best();
    POLYPOD_TRY(ledger.ask(around, Phase::refine));
    if (*ledger.best() == before) return {};
  }
  return {};
}

/// From the best each parameter alone at the ends of its range, all of them in one batch, then those together that
/// gained, until nothing gains: optima of machines often lie in a corner, which small steps reach slowly.
Status try_ends(Ledger& ledger) {
  const std::vector<std::size_t> free = without_steps(ledger.study());
  while (!ledger.over()) {
    const std::size_t before = *ledger.best();
    const Shares u = ledger.best_shares();
    std::vector<Member> ends;
    std::vector<std::size_t> which;
    for (const std::size_t i : free) {
      for (const double end : {0.0, 1.0}) {
        if (u[i] == end) continue;
        ends.push_back({u, 0});
        ends.back().u[i] = end;
        which.push_back(i);
      }
    }
    POLYPOD_TRY(ledger.ask_in_place(ends, Phase::refine));
    if (ledger.over() || *ledger.best() == before) return {};
    std::vector<Member> together{{u, 0}};
    std::vector<Rank> reached(ledger.n(), rank(ledger, {u, before}));
    for (std::size_t k = 0; k < ends.size(); ++k) {
      const std::size_t i = which[k];
      if (ends[k].u.empty() || !(rank(ledger, ends[k]) > reached[i])) continue;
      reached[i] = rank(ledger, ends[k]);
      together[0].u[i] = ends[k].u[i];
    }
    POLYPOD_TRY(ledger.ask(together, Phase::refine));
  }
  return {};
}

/// The subplex method from the best.
Status refine(Ledger& ledger, double step) {
  const std::vector<std::size_t> free = without_steps(ledger.study());
  if (free.empty() || ledger.over()) return {};
  const Shares u = ledger.best_shares();
  Shares from;
  for (const std::size_t i : free) from.push_back(u[i]);
  Status failed;
  constexpr int kCallsEach = 4;  // what is asked again costs no evaluation
  constexpr double kLowest = -1e30, kBroken = 1e9;
  subplex(
      from, step, kCallsEach * static_cast<int>(ledger.left()),
      [&](const Shares& at) {
        std::vector<Member> one{{u, 0}};
        for (std::size_t k = 0; k < free.size(); ++k) one[0].u[free[k]] = at[k];
        failed = ledger.ask(one, Phase::refine);
        if (!failed || one.empty()) return kLowest;
        const Rank r = rank(ledger, one[0]);
        if (r.violation > 0) return -kBroken * (1 + std::min(r.violation, kBroken));
        return r.objective;
      },
      [&] { return !failed || ledger.over(); });
  return failed;
}

}  // namespace

Status find_best(Ledger& ledger) {
  constexpr int kMostRounds = 20;
  constexpr double kGlobal = 0.6, kFirstStep = 0.08, kLaterStep = 0.03;
  for (int round = 0; round < kMostRounds && !ledger.over(); ++round) {
    const std::int64_t before = ledger.left();
    POLYPOD_TRY(evolve(ledger, static_cast<std::int64_t>(kGlobal * static_cast<double>(before)), round == 0));
    if (ledger.best()) {
      POLYPOD_TRY(climb(ledger));
      POLYPOD_TRY(try_ends(ledger));
      POLYPOD_TRY(refine(ledger, round == 0 ? kFirstStep : kLaterStep));
    }
    if (ledger.left() == before) break;  // nothing new is left to try
  }
  return {};
}

}  // namespace polypod::design
