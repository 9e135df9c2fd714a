// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The farthest vertex against every combination of signs, for generators in general position and in none.
#include "polypod/quality/zonotope.hpp"

#include <gtest/gtest.h>

#include <random>

namespace polypod::quality {
namespace {

double brute_force(const std::vector<Vec3>& g) {
  double best = 0;
  Vec3 sum = Vec3::Zero();
  for (const Vec3& v : g) sum += v;
  best = sum.norm();
  // Gray code: one sign changes at a time.
  std::vector<double> sign(g.size(), 1);
  for (std::size_t k = 1; k < std::size_t{1} << (g.size() - 1); ++k) {
    const auto i = static_cast<std::size_t>(__builtin_ctzll(k));
    sum -= 2 * sign[i] * g[i];
    sign[i] = -sign[i];
    best = std::max(best, sum.norm());
  }
  return best;
}

void expect_farthest(const std::vector<Vec3>& g, const char* what) {
  const Farthest found = farthest_vertex(g);
  double length = 1e-300;
  Vec3 sum = Vec3::Zero();
  for (std::size_t i = 0; i < g.size(); ++i) {
    length += g[i].norm();
    sum += static_cast<double>(found.signs[i]) * g[i];
  }
  const double kRounding = 1e-12 * length;
  EXPECT_NEAR(found.distance, brute_force(g), kRounding) << what << ", " << g.size();
  EXPECT_NEAR((sum - found.point).norm(), 0, kRounding) << what;
  const Farthest searched = flip_search(g);
  EXPECT_LE(searched.distance, found.distance + kRounding) << what;
  Vec3 there = Vec3::Zero();
  for (std::size_t i = 0; i < g.size(); ++i) there += static_cast<double>(searched.signs[i]) * g[i];
  EXPECT_NEAR((there - searched.point).norm(), 0, kRounding) << what;
}

TEST(Zonotope, IsExactInGeneralPosition) {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  for (int n = 1; n <= 20; ++n) {
    for (int k = 0; k < (n > 14 ? 2 : 30); ++k) {
      std::vector<Vec3> g;
      for (int i = 0; i < n; ++i)
        g.emplace_back(Vec3(normal(random), normal(random), normal(random)) * std::exp(2 * normal(random)));
      expect_farthest(g, "general");
    }
  }
}

TEST(Zonotope, IsExactForPlanarParallelAndZeroGenerators) {
  std::mt19937 random(2);
  std::normal_distribution<double> normal;
  std::uniform_int_distribution<int> step(-2, 2);
  for (int k = 0; k < 400; ++k) {
    const int n = 1 + k % 11;
    std::vector<Vec3> lattice, planar, parallel, mixed;
    const Vec3 a(normal(random), normal(random), normal(random)), b(normal(random), normal(random), normal(random));
    for (int i = 0; i < n; ++i) {
      lattice.emplace_back(step(random), step(random), step(random));  // many ties, zeros and multiples
      planar.push_back(normal(random) * a + normal(random) * b);
      parallel.push_back(normal(random) * a);
      mixed.push_back(i % 3 == 0   ? Vec3(step(random) * a)
                      : i % 3 == 1 ? Vec3(step(random) * a + step(random) * b)
                                   : Vec3(Vec3::Unit(i % 2) * normal(random)));
    }
    expect_farthest(lattice, "lattice");
    expect_farthest(planar, "planar");
    expect_farthest(parallel, "parallel");
    expect_farthest(mixed, "mixed");
  }
  EXPECT_EQ(farthest_vertex({}).distance, 0);
  EXPECT_EQ(flip_search({}).distance, 0);
}

TEST(Zonotope, SearchStopsInALocalMaximumWhereJelenkovicsDoes) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  int below = 0;
  constexpr int kTrials = 200;
  for (int k = 0; k < kTrials; ++k) {
    std::vector<Vec3> many;
    for (int i = 0; i < 12; ++i) many.emplace_back(normal(random), normal(random), normal(random));
    below += flip_search(many).distance < farthest_vertex(many).distance * (1 - 1e-9) ? 1 : 0;
  }
  EXPECT_GT(below, 0);  // it does stop short
}

}  // namespace
}  // namespace polypod::quality
