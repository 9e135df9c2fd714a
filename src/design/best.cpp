// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The search for one machine: several starts, each with evolution over all ranges and then what is nearest to its best;
// what is left of the evaluations goes to the best of all.
#include <algorithm>
#include <cmath>
#include <deque>
#include <numbers>

#include "expected.hpp"

namespace polypod::design {
namespace {

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

/// Differential evolution of one population, a trial after another for each member in turn. A better trial takes the
/// place of its parent as soon as it is known, and the parent goes into an archive.
class Evolution {
 public:
  Evolution(Ledger& ledger, std::vector<Member> population, std::int64_t budget)
      : ledger_(ledger), budget_(budget), end_(ledger.left() - budget), start_size_(population.size()) {
    for (Member& m : population) population_.push_back({std::move(m), ids_++});
  }

  std::optional<Shares> next() {
    constexpr int kIdle = 30;  // rounds without a new candidate
    if (ledger_.left() <= end_ || population_.size() < 4 || idle_ >= kIdle * static_cast<int>(population_.size()))
      return std::nullopt;
    if (at_ == 0) begin_round();
    const std::size_t i = at_;
    at_ = (at_ + 1) % population_.size();
    const auto [CR, F] = memory_.draw(ledger_);
    in_work_.push_back({population_[i].id, CR, F});
    return trial(i, F, CR);
  }

  void known(const Member& m, bool fresh) {
    idle_ = fresh ? 0 : idle_ + 1;
    const Trial of = in_work_.front();
    in_work_.pop_front();
    const auto parent =
        std::find_if(population_.begin(), population_.end(), [&](const Individual& p) { return p.id == of.parent; });
    if (parent == population_.end()) return;  // the population has become smaller
    const Rank now = rank(ledger_, m), was = rank(ledger_, parent->m);
    if (was > now) return;
    if (now > was) {
      archive_.push_back(parent->m.u);
      while (archive_.size() > start_size_)
        archive_.erase(archive_.begin() + static_cast<std::ptrdiff_t>(ledger_.below(archive_.size())));
      const double gain = now.objective - was.objective;
      constexpr double kSomeGain = 1e-6;
      memory_.add(std::isfinite(gain) && gain > 0 ? gain : kSomeGain, of.F, of.CR);
    }
    parent->m = m;
  }

  void improve_with(Member& best) const {
    for (const Individual& p : population_) improve(ledger_, best, p.m);
  }

 private:
  struct Individual {
    Member m;
    int id = 0;
  };
  struct Trial {
    int parent = 0;
    double CR = 0, F = 0;
  };

  /// The best first; the population shrinks with the evaluations that are left.
  void begin_round() {
    constexpr std::size_t kLeast = 5;
    memory_.keep();
    std::stable_sort(population_.begin(), population_.end(),
                     [&](const Individual& a, const Individual& b) { return rank(ledger_, a.m) > rank(ledger_, b.m); });
    const double done = 1 - static_cast<double>(ledger_.left() - end_) / static_cast<double>(budget_);
    const double size =
        static_cast<double>(start_size_) - done * static_cast<double>(start_size_ - std::min(start_size_, kLeast));
    population_.resize(std::min(population_.size(), std::max(static_cast<std::size_t>(std::lround(size)), kLeast)));
  }

  Shares trial(std::size_t i, double F, double CR) {
    constexpr double kBestShare = 0.15;
    const std::size_t n = population_.size();
    const auto best =
        std::max<std::size_t>(2, static_cast<std::size_t>(std::lround(kBestShare * static_cast<double>(n))));
    const Shares& p = population_[ledger_.below(best)].m.u;
    std::size_t a = i;
    while (a == i) a = ledger_.below(n);
    std::size_t b = i;
    while (b == i || b == a) b = ledger_.below(n + archive_.size());
    const Shares& x = population_[i].m.u;
    const Shares &x_a = population_[a].m.u, &x_b = b < n ? population_[b].m.u : archive_[b - n];
    Shares out = x;
    const std::size_t surely = ledger_.below(ledger_.n());
    for (std::size_t k = 0; k < ledger_.n(); ++k) {
      if (ledger_.random().uniform() >= CR && k != surely) continue;
      out[k] = std::clamp(x[k] + F * (p[k] - x[k]) + F * (x_a[k] - x_b[k]), 0.0, 1.0);
    }
    return out;
  }

  Ledger& ledger_;
  std::int64_t budget_, end_;  // evaluations that it has, and that stay
  std::size_t start_size_;
  std::vector<Individual> population_;
  std::vector<Shares> archive_;
  std::deque<Trial> in_work_;
  Memory memory_;
  std::size_t at_ = 0;
  int ids_ = 0, idle_ = 0;
};

/// Leaves the best of the last population in `best`.
Status evolve(Ledger& ledger, std::int64_t budget, bool first, Member& best) {
  constexpr std::size_t kTrialsInWork = 8;  // with one it finds no higher hills
  const std::int64_t end = ledger.left() - budget;
  const auto most = static_cast<std::int64_t>(8 * ledger.n() + 8);
  const auto start_size = static_cast<std::size_t>(std::clamp(budget / 6, std::int64_t{6}, most));
  std::vector<Member> population = ledger.latin(start_size, first);
  POLYPOD_TRY(ledger.ask(population, Phase::sample));
  if (ledger.left() > end && !population.empty()) {
    Evolution evolution(ledger, population, ledger.left() - end);
    POLYPOD_TRY(ledger.ask_in_turn({kTrialsInWork, Phase::search, [&](const auto&) { return evolution.next(); },
                                    [&](const Member& m, bool fresh) { evolution.known(m, fresh); }}));
    evolution.improve_with(best);
    return {};
  }
  for (const Member& m : population) improve(ledger, best, m);
  return {};
}

std::vector<std::size_t> without_steps(const Study& study) {
  std::vector<std::size_t> out;
  for (std::size_t i = 0; i < study.vary.size(); ++i)
    if (!study.vary[i].count()) out.push_back(i);
  return out;
}

/// Neighbours of the best in what has steps or a list, until none is better.
Status climb(Ledger& ledger, std::int64_t end, Member& best) {
  for (bool better = true; better && ledger.left() > end && !ledger.over();) {
    std::vector<Member> around;
    for (std::size_t i = 0; i < ledger.n(); ++i) {
      const Vary& v = ledger.study().vary[i];
      const auto count = v.count();
      if (!count || *count < 2) continue;
      const double each = v.values.empty() ? 1.0 / static_cast<double>(*count - 1) : 1.0 / static_cast<double>(*count);
      for (const double sign : {-1.0, 1.0}) {
        Member m{best.u, 0};
        m.u[i] += sign * each;
        if (m.u[i] > -1e-9 && m.u[i] < 1 + 1e-9) around.push_back(std::move(m));
      }
    }
    POLYPOD_TRY(ledger.ask(around, Phase::refine));
    better = false;
    for (const Member& m : around) better = improve(ledger, best, m) || better;
  }
  return {};
}

/// From the best each parameter alone at the ends of its range, all of them in one batch, then those together that
/// gained, until nothing gains: optima of machines often lie in a corner, which small steps reach slowly.
Status try_ends(Ledger& ledger, std::int64_t end, Member& best) {
  const std::vector<std::size_t> free = without_steps(ledger.study());
  for (bool better = true; better && ledger.left() > end && !ledger.over();) {
    const Member from = best;
    std::vector<Member> ends;
    std::vector<std::size_t> which;
    for (const std::size_t i : free) {
      for (const double at : {0.0, 1.0}) {
        if (from.u[i] == at) continue;
        ends.push_back({from.u, 0});
        ends.back().u[i] = at;
        which.push_back(i);
      }
    }
    POLYPOD_TRY(ledger.ask_in_place(ends, Phase::refine));
    std::vector<Member> together{{from.u, 0}};
    std::vector<Rank> reached(ledger.n(), rank(ledger, from));
    better = false;
    for (std::size_t k = 0; k < ends.size(); ++k) {
      const std::size_t i = which[k];
      if (ends[k].u.empty() || !(rank(ledger, ends[k]) > reached[i])) continue;
      reached[i] = rank(ledger, ends[k]);
      together[0].u[i] = ends[k].u[i];
      better = improve(ledger, best, ends[k]) || better;
    }
    if (!better) break;
    POLYPOD_TRY(ledger.ask(together, Phase::refine));
    for (const Member& m : together) improve(ledger, best, m);
  }
  return {};
}

/// What is nearest to `best`, until `end` evaluations are left. Whether it ended by itself.
Result<bool> go_up(Ledger& ledger, std::int64_t end, double step, Member& best) {
  POLYPOD_TRY(climb(ledger, end, best));
  POLYPOD_TRY(try_ends(ledger, end, best));
  return refine(ledger, without_steps(ledger.study()), {end, step}, best);
}

constexpr double kFirstStep = 0.08, kLaterStep = 0.03;

/// One start: a new sample and evolution for a share `global` of `budget`, then what is nearest to its best.
Status start(Ledger& ledger, std::int64_t budget, double global, bool first, Member& best) {
  const std::int64_t before = ledger.left(), end = before - budget;
  Member found;
  POLYPOD_TRY(evolve(ledger, static_cast<std::int64_t>(global * static_cast<double>(budget)), first, found));
  if (found.u.empty() || std::isinf(ledger.of(found).violation)) return {};  // nothing that could be judged
  POLYPOD_ASSIGN(ended, go_up(ledger, end, kFirstStep, found));
  ledger.add_start({static_cast<int>(before - ledger.left()), ledger.rows()[found.row].row, ended});
  improve(ledger, best, found);
  return {};
}

/// Models first, then what is nearest to their best, and again while evaluations are left.
Status find_by_models(Ledger& ledger) {
  constexpr double kForTheBest = 0.2;
  constexpr int kMostRounds = 20;
  Member best;
  for (int round = 0; round < kMostRounds && !ledger.over(); ++round) {
    const std::int64_t before = ledger.left();
    const auto ends = static_cast<std::int64_t>(2 * ledger.n() + 4);
    POLYPOD_TRY(expect(
        ledger,
        std::min(std::max(static_cast<std::int64_t>(kForTheBest * static_cast<double>(before)), ends), before / 2),
        best));
    if (!best.u.empty() && !std::isinf(ledger.of(best).violation)) {
      POLYPOD_TRY(go_up(ledger, 0, round == 0 ? kFirstStep : kLaterStep, best));
    }
    if (ledger.left() == before) break;  // nothing new is left to try
  }
  return {};
}

}  // namespace

Status find_best(Ledger& ledger) {
  if (takes_models(ledger)) return find_by_models(ledger);
  // As many starts as have enough evaluations to find their hill; a fifth is kept for the best of them. One start alone
  // must do with its evolution, of several each goes up what it finds. On hills like those of JEL's rail hexapods three
  // starts with 200 evaluations find the highest of three with 17 of 30 seeds, one start with 3.
  constexpr double kForTheBest = 0.2, kGlobalOfOne = 0.6, kGlobalOfSeveral = 0.4;
  constexpr std::int64_t kMostStarts = 5;
  constexpr int kMostRounds = 20;
  constexpr std::int64_t kEach = 50, kForEachParameter = 3;  // evaluations of a start at least
  const std::int64_t all = ledger.left();
  const auto planned = std::clamp(all / (kEach + kForEachParameter * static_cast<std::int64_t>(ledger.n())),
                                  std::int64_t{1}, kMostStarts);
  Member best;
  for (std::int64_t k = 0; k < planned && !ledger.over(); ++k) {
    const auto kept = static_cast<std::int64_t>(planned > 1 ? kForTheBest * static_cast<double>(all) : 0);
    POLYPOD_TRY(start(ledger, (ledger.left() - kept) / (planned - k), planned > 1 ? kGlobalOfSeveral : kGlobalOfOne,
                      k == 0, best));
  }
  if (!best.u.empty()) POLYPOD_TRY(go_up(ledger, 0, kLaterStep, best));
  for (int round = 0; round < kMostRounds && !ledger.over(); ++round) {
    const std::int64_t before = ledger.left();
    POLYPOD_TRY(start(ledger, before, kGlobalOfOne, false, best));
    if (ledger.left() == before) break;  // nothing new is left to try
  }
  return {};
}

}  // namespace polypod::design
