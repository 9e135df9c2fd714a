// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The search for a front: models where there are few evaluations, then and else NSGA-II (Deb 2002).
#include <algorithm>
#include <cmath>
#include <numeric>

#include "models.hpp"

namespace polypod::design {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();

/// What NSGA-II sorts by: constrained domination, then the distance to the neighbours on the same front.
struct Sorted {
  std::vector<int> front;
  std::vector<double> crowding;

  [[nodiscard]] bool before(std::size_t a, std::size_t b) const {
    return front[a] != front[b] ? front[a] < front[b] : crowding[a] > crowding[b];
  }
};

Sorted sorted(const Ledger& ledger, const std::vector<Member>& members) {
  const std::size_t n = members.size();
  std::vector<std::vector<double>> g;
  std::vector<double> violation;
  for (const Member& m : members) {
    g.push_back(middle_goals(ledger.study(), ledger.of(m)));
    violation.push_back(ledger.of(m).violation);
  }
  const auto beats = [&](std::size_t a, std::size_t b) {
    if (violation[a] != violation[b]) return violation[a] < violation[b];
    return violation[a] == 0 && dominates(g[a], g[b]);
  };
  Sorted out{std::vector<int>(n, -1), std::vector<double>(n, 0)};
  std::size_t placed = 0;
  for (int front = 0; placed < n; ++front) {
    std::vector<std::size_t> here;
    for (std::size_t i = 0; i < n; ++i) {
      if (out.front[i] >= 0) continue;
      bool beaten = false;
      for (std::size_t k = 0; k < n && !beaten; ++k) beaten = k != i && out.front[k] < 0 && beats(k, i);
      if (!beaten) here.push_back(i);
    }
    for (const std::size_t i : here) out.front[i] = front;
    placed += here.size();
    for (std::size_t k = 0; !g.empty() && k < g[0].size(); ++k) {
      std::stable_sort(here.begin(), here.end(), [&](std::size_t a, std::size_t b) { return g[a][k] < g[b][k]; });
      const double span = g[here.back()][k] - g[here.front()][k];
      out.crowding[here.front()] = out.crowding[here.back()] = kInf;
      for (std::size_t i = 1; i + 1 < here.size() && span > 0 && std::isfinite(span); ++i)
        out.crowding[here[i]] += (g[here[i + 1]][k] - g[here[i - 1]][k]) / span;
    }
  }
  return out;
}

/// Simulated binary crossover; of what is crossed each child has either side by chance, so that the parents mix.
void cross(Random& random, Shares& a, Shares& b) {
  constexpr double kChance = 0.9, kIndex = 15;
  if (random.uniform() >= kChance) return;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (random.uniform() >= 0.5) continue;
    const double r = random.uniform();
    const double beta = r < 0.5 ? std::pow(2 * r, 1 / (kIndex + 1)) : std::pow(0.5 / (1 - r), 1 / (kIndex + 1));
    const double x = a[i], y = b[i];
    a[i] = std::clamp(0.5 * ((1 + beta) * x + (1 - beta) * y), 0.0, 1.0);
    b[i] = std::clamp(0.5 * ((1 - beta) * x + (1 + beta) * y), 0.0, 1.0);
    if (random.uniform() < 0.5) std::swap(a[i], b[i]);
  }
}

/// Polynomial mutation.
void mutate(Random& random, Shares& u) {
  constexpr double kIndex = 20;
  for (double& x : u) {
    if (random.uniform() >= 1.0 / static_cast<double>(u.size())) continue;
    const double r = random.uniform();
    const double delta = r < 0.5 ? std::pow(2 * r, 1 / (kIndex + 1)) - 1 : 1 - std::pow(2 * (1 - r), 1 / (kIndex + 1));
    x = std::clamp(x + delta, 0.0, 1.0);
  }
}

std::vector<Member> children_of(Ledger& ledger, const std::vector<Member>& parents, std::size_t size) {
  const Sorted order = sorted(ledger, parents);
  // Tournaments of two, in which each parent takes part before any does again.
  std::vector<std::size_t> draw;
  const auto next = [&] {
    if (draw.empty()) {
      draw.resize(parents.size());
      std::iota(draw.begin(), draw.end(), std::size_t{0});
    }
    std::swap(draw[ledger.below(draw.size())], draw.back());
    const std::size_t out = draw.back();
    draw.pop_back();
    return out;
  };
  const auto chosen = [&]() -> const Shares& {
    const std::size_t a = next(), b = next();
    return parents[order.before(b, a) ? b : a].u;
  };
  std::vector<Member> out;
  while (out.size() < size) {
    Shares a = chosen(), b = chosen();
    cross(ledger.random(), a, b);
    mutate(ledger.random(), a);
    mutate(ledger.random(), b);
    out.push_back({std::move(a), 0});
    if (out.size() < size) out.push_back({std::move(b), 0});
  }
  return out;
}

/// The first `size` of both, each candidate once.
std::vector<Member> survivors(const Ledger& ledger, std::vector<Member>& parents, std::vector<Member>& children,
                              std::size_t size) {
  std::set<std::size_t> rows;
  std::vector<Member> all;
  for (auto* list : {&parents, &children})
    for (Member& m : *list)
      if (rows.insert(m.row).second) all.push_back(std::move(m));
  const Sorted order = sorted(ledger, all);
  std::vector<std::size_t> by(all.size());
  std::iota(by.begin(), by.end(), std::size_t{0});
  std::stable_sort(by.begin(), by.end(), [&](std::size_t a, std::size_t b) { return order.before(a, b); });
  std::vector<Member> out;
  for (std::size_t i = 0; i < std::min(size, by.size()); ++i) out.push_back(std::move(all[by[i]]));
  return out;
}

}  // namespace

Status find_front(Ledger& ledger) {
  const auto size = static_cast<std::size_t>(std::clamp<std::int64_t>(ledger.left() / 12, 8, 100));
  std::vector<Member> population;
  if (takes_models(ledger)) {
    POLYPOD_ASSIGN(found, expect_front(ledger));
    population = std::move(found);
  } else {
    population = ledger.latin(size, true);
    POLYPOD_TRY(ledger.ask(population, Phase::sample));
  }
  int idle = 0;
  constexpr int kIdle = 30;  // generations without a new candidate
  while (!ledger.over() && population.size() >= 2 && idle < kIdle) {
    std::vector<Member> children = children_of(ledger, population, size);
    const std::size_t before = ledger.rows().size();
    POLYPOD_TRY(ledger.ask(children, Phase::search));
    idle = ledger.rows().size() == before ? idle + 1 : 0;
    population = survivors(ledger, population, children, size);
  }
  return {};
}

}  // namespace polypod::design
