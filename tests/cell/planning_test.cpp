// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Planning methods against layouts that can be found by hand.
#include "polypod/cell/planning.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

namespace polypod::cell {
namespace {

constexpr double kRounding = 1e-9;

TEST(Planning, TriangularMethodByHand) {
  // Four stations, flows 1-2: 10, 1-3: 8, 2-3: 6, 3-4: 5, 2-4: 2. By hand: 1 and 2 begin on neighbouring nodes; 3 (8 +
  // 6) has both as neighbours, so that all its ways are 1; 4 (5 + 2) stands beside 2 and 3. Every flow runs over a side
  // of 1.
  const FlowMatrix flows = flow_matrix(4, {{0, 1, 10}, {0, 2, 8}, {1, 2, 6}, {2, 3, 5}, {1, 3, 2}});
  const Plan plan = triangular(flows);
  EXPECT_NEAR(plan.score, 10 + 8 + 6 + 5 + 2, kRounding);
  ASSERT_TRUE(plan.best);
  EXPECT_NEAR(*plan.best, plan.score, kRounding) << "no flow can run shorter than a side";
  for (const auto& [a, b] : {std::pair{0, 1}, {0, 2}, {1, 2}, {2, 3}, {1, 3}})
    EXPECT_NEAR((plan.places[std::size_t(a)] - plan.places[std::size_t(b)]).norm(), 1, kRounding);
}

TEST(Planning, FiveEqualFlowsCannotAllBeNeighbours) {
  // All ten pairs of five stations with flow 1 on five nodes about a rhomb: the method grows a compact patch; three
  // nodes in a row and two above have seven sides of 1, two diagonals of sqrt 3 and one way of 2.
  std::vector<Flow> flows;
  for (int i = 0; i < 5; ++i)
    for (int k = i + 1; k < 5; ++k) flows.push_back({i, k, 1});
  const Plan plan = triangular(flow_matrix(5, flows));
  EXPECT_NEAR(plan.score, 7 + 2 * std::numbers::sqrt3 + 2, kRounding);
  EXPECT_NEAR(*plan.best, plan.score, kRounding);
}

TEST(Planning, CircleMethodPutsAChainInItsOrder) {
  // A ring of flows in a mixed order: the best circle has each flow on a side, which is 1 long.
  const FlowMatrix flows = flow_matrix(6, {{0, 3, 1}, {3, 1, 1}, {1, 4, 1}, {4, 2, 1}, {2, 5, 1}, {5, 0, 1}});
  const Plan plan = circle(flows);
  ASSERT_TRUE(plan.best);
  EXPECT_NEAR(*plan.best, 6, kRounding);
  EXPECT_GE(plan.score, *plan.best - kRounding);
  // Three stations: every order is one.
  const Plan three = circle(flow_matrix(3, {{0, 1, 2}, {1, 2, 3}, {0, 2, 4}}));
  EXPECT_NEAR(three.score, 9, kRounding);
}

TEST(Planning, CoordinateMethodIsTheCentreOfGravity) {
  // Weights 1, 1, 2 at (0, 0), (4, 0), (0, 4): the weighted mean is (1, 2).
  const std::vector<Station> stations{
      {"a", {0, 0, 0}, true}, {"b", {4, 0, 0}, true}, {"c", {0, 4, 0}, true}, {"new", {9, 9, 0}, false}};
  const Plan plan = coordinates(flow_matrix(4, {{0, 3, 1}, {1, 3, 1}, {2, 3, 2}}), stations);
  EXPECT_NEAR(plan.places[3].x(), 1, 1e-7);
  EXPECT_NEAR(plan.places[3].y(), 2, 1e-7);
  // The place of the least sum of ways for three equal weights is Fermat's point, from which all see each other at 120
  // deg; of an equilateral triangle it is the middle, where both agree.
  const double h = std::numbers::sqrt3;
  const std::vector<Station> equal{
      {"a", {-1, 0, 0}, true}, {"b", {1, 0, 0}, true}, {"c", {0, h, 0}, true}, {"new", {0.3, 0.1, 0}, false}};
  const Plan fermat = coordinates(flow_matrix(4, {{0, 3, 1}, {1, 3, 1}, {2, 3, 1}}), equal);
  EXPECT_NEAR(*fermat.best, 2 * h, 1e-6);
  EXPECT_NEAR(fermat.score, 2 * h, 1e-6);
  // Where they differ: weights 1, 1, 1 on a line at 0, 1, 10. Mean 11/3 with 3.667 + 2.667 + 6.333; least at the
  // median 1.
  const std::vector<Station> on_line{
      {"a", {0, 0, 0}, true}, {"b", {1, 0, 0}, true}, {"c", {10, 0, 0}, true}, {"new", {5, 3, 0}, false}};
  const Plan median = coordinates(flow_matrix(4, {{0, 3, 1}, {1, 3, 1}, {2, 3, 1}}), on_line);
  EXPECT_NEAR(median.score, 11.0 / 3 + 8.0 / 3 + 19.0 / 3, 1e-6);
  EXPECT_NEAR(*median.best, 10, kRounding);
}

/// The least sum over all ways in which free stations can lie on fixed ones or on each other: each way is a problem
/// whose groups lie apart at its optimum, solved by Weiszfeld's iteration from several places.
double least_by_coincidences(const FlowMatrix& flows, const std::vector<Station>& stations, std::mt19937& random) {
  const std::size_t n = stations.size();
  std::vector<std::size_t> free, group(n);
  std::size_t fixed = 0;
  for (std::size_t i = 0; i < n; ++i) {
    if (!stations[i].fixed) free.push_back(i);
    if (stations[i].fixed) fixed = i + 1;  // fixed ones stand first
  }
  std::uniform_real_distribution<double> anywhere(0, 7);
  double best = 1e300;
  const auto solve = [&](std::size_t groups) {
    std::vector<Vec2> at(groups);
    for (std::size_t g = 0; g < groups; ++g)
      at[g] = g < fixed ? Vec2(stations[g].at.head<2>()) : Vec2(anywhere(random), anywhere(random));
    for (int round = 0; round < 1500; ++round) {
      for (std::size_t g = fixed; g < groups; ++g) {
        Vec2 sum = Vec2::Zero();
        double weight = 0;
        for (std::size_t i = 0; i < n; ++i) {
          if (group[i] != g) continue;
          for (std::size_t k = 0; k < n; ++k) {
            if (group[k] == g || !(flows(long(i), long(k)) > 0)) continue;
            const double w = flows(long(i), long(k)) / std::max(1e-12, (at[g] - at[group[k]]).norm());
            sum += w * at[group[k]];
            weight += w;
          }
        }
        if (weight > 0) at[g] = sum / weight;
      }
    }
    std::vector<Vec2> places(n);
    for (std::size_t i = 0; i < n; ++i) places[i] = at[group[i]];
    best = std::min(best, transport(flows, places));
  };
  const std::function<void(std::size_t, std::size_t)> choose = [&](std::size_t next, std::size_t groups) {
    if (next == free.size()) {
      for (int start = 0; start < 2; ++start) solve(groups);
      return;
    }
    for (std::size_t g = 0; g <= groups; ++g) {
      group[free[next]] = g;
      choose(next + 1, std::max(groups, g + 1));
    }
  };
  for (std::size_t i = 0; i < fixed; ++i) group[i] = i;
  choose(0, fixed);
  return best;
}

// Weiszfeld's iteration stops where a station comes to lie on another one: 529.859 here. The optimum has all three free
// stations on fixed ones, and the dual proves it.
TEST(Planning, CoordinateMethodFindsStationsOnEachOther) {
  const std::vector<Station> stations{{"s0", {1, 1, 0}, true},  {"s1", {2, 6, 0}, true},  {"s2", {5, 4, 0}, true},
                                      {"s3", {1, 7, 0}, false}, {"s4", {7, 2, 0}, false}, {"s5", {0, 3, 0}, false}};
  const FlowMatrix flows = flow_matrix(6, {{0, 4, 39},
                                           {0, 5, 3},
                                           {1, 0, 6},
                                           {1, 2, 2},
                                           {1, 5, 12},
                                           {2, 4, 17},
                                           {2, 5, 26},
                                           {3, 0, 27},
                                           {3, 2, 15},
                                           {3, 4, 35},
                                           {4, 1, 22},
                                           {4, 3, 35},
                                           {5, 0, 2},
                                           {5, 1, 20},
                                           {5, 2, 21},
                                           {5, 4, 13}});
  const Plan plan = coordinates(flows, stations);
  // 28 from s1 to s0, 50 from s0 to s2, 34 from s1 to s2.
  EXPECT_NEAR(*plan.best, 28 * std::sqrt(26) + 50 * 5 + 34 * std::sqrt(13), kRounding);
  EXPECT_EQ(plan.best_places[3], Vec2(1, 1));
  EXPECT_EQ(plan.best_places[4], Vec2(1, 1));
  EXPECT_EQ(plan.best_places[5], Vec2(5, 4));
  ASSERT_TRUE(plan.bound);
  EXPECT_LE(*plan.bound, *plan.best);
  EXPECT_GT(*plan.bound, *plan.best * (1 - 1e-6));
  EXPECT_EQ(rounded_down(*plan.bound), "515.361");
}

// Whole numbers and few places make coincidences frequent; also groups of free stations that lie on no fixed one.
TEST(Planning, LeastWaysAgreeWithEnumeratedCoincidencesAndTheirBound) {
  constexpr double kSame = 1e-6;  // of the sum; Weiszfeld's iteration converges slowly
  std::mt19937 random(11);
  int together = 0, on_fixed = 0;
  for (int round = 0; round < 40; ++round) {
    std::vector<Station> stations;
    for (int i = 0; i < 6; ++i)
      stations.push_back({"s", Vec3(static_cast<double>(random() % 8), static_cast<double>(random() % 8), 0), i < 3});
    std::vector<Flow> list;
    for (int i = 0; i < 6; ++i)
      for (int k = std::max(i + 1, 3); k < 6; ++k)
        if (random() % 4 != 0) list.push_back({i, k, static_cast<double>(random() % (i < 3 ? 10 : 20))});
    const FlowMatrix flows = flow_matrix(6, list);
    const Plan plan = coordinates(flows, stations);
    const double least = least_by_coincidences(flows, stations, random);
    const double scale = std::max(1.0, least);
    EXPECT_LE(*plan.best, least + kSame * scale) << round;
    EXPECT_GE(*plan.best, least - 1e-3 * scale) << round << ": coincidences that were not enumerated?";
    EXPECT_NEAR(transport(flows, plan.best_places), *plan.best, 1e-12 * scale);
    EXPECT_LE(*plan.bound, *plan.best);
    EXPECT_GE(*plan.bound, *plan.best - kSame * scale) << round;
    for (std::size_t i = 3; i < 6; ++i) {
      for (std::size_t k = 0; k < i; ++k) {
        if (plan.best_places[i] != plan.best_places[k]) continue;
        (k < 3 ? on_fixed : together)++;
      }
    }
    // No other places are below the bound.
    for (int start = 0; start < 200; ++start) {
      std::vector<Vec2> places = plan.best_places;
      for (std::size_t i = 3; i < 6; ++i)
        places[i] += std::pow(10.0, -static_cast<double>(random() % 6)) *
                     Vec2(static_cast<double>(random() % 200) / 100 - 1, static_cast<double>(random() % 200) / 100 - 1);
      EXPECT_GE(transport(flows, places), *plan.bound - 1e-9 * scale);
    }
  }
  EXPECT_GT(together, 5);
  EXPECT_GT(on_fixed, 20);
}

TEST(Planning, LeastWaysWithoutTies) {
  // Free stations that send only each other something meet at no cost; one without flows stays; one fixed place takes
  // all that is tied to it.
  const std::vector<Station> stations{
      {"a", {2, 2, 0}, true}, {"b", {0, 0, 0}, false}, {"c", {4, 2, 0}, false}, {"d", {9, 9, 0}, false}};
  const Plan plan = coordinates(flow_matrix(4, {{1, 2, 5}}), stations);
  EXPECT_EQ(*plan.best, 0);
  EXPECT_EQ(*plan.bound, 0);
  EXPECT_EQ(plan.best_places[3], Vec2(9, 9));
  const Plan tied = coordinates(flow_matrix(4, {{1, 2, 5}, {2, 0, 1}}), stations);
  EXPECT_EQ(*tied.best, 0);
  EXPECT_EQ(tied.best_places[1], Vec2(2, 2));
}

TEST(Planning, RelationshipChartByHand) {
  // 1-2 A, 1-3 A, 2-3 E, 3-4 I, 1-4 X. Totals: 1: 4 + 4 - 1 = 7, 2: 7, 3: 4 + 3 + 2 = 9, 4: 1. So 3 first, then 1 (A
  // with 3, and total 7, as 2 has E), then 2 (A with 1), then 4. Adjacent by sides: 3-1 (4), 2 beside 1 and at a corner
  // of 3 (4 + 3/2), 4 beside 3 and away from 1 (2) - and not beside 1. Sum 11.5.
  const std::vector<Relation> chart{
      {0, 1, 'A', ""}, {0, 2, 'A', ""}, {1, 2, 'E', ""}, {2, 3, 'I', ""}, {0, 3, 'X', ""}};
  const Plan plan = systematic(4, chart);
  EXPECT_NEAR(plan.score, 11.5, kRounding);
  ASSERT_TRUE(plan.best);
  EXPECT_GE(*plan.best, plan.score - kRounding);
  EXPECT_TRUE(plan.larger_is_better);
}

TEST(Planning, EnumerationAgreesWithAnExhaustiveSearchOfItsOwn) {
  // Five stations on five places in a row: the sum by another recursion.
  std::mt19937 random(7);
  FlowMatrix flows = FlowMatrix::Zero(5, 5);
  for (int i = 0; i < 5; ++i)
    for (int k = i + 1; k < 5; ++k) flows(i, k) = flows(k, i) = static_cast<double>(random() % 10);
  const std::vector<Vec2> places{{0, 0}, {1, 0}, {2, 0}, {3, 0}, {4, 0}};
  double best = 1e9;
  std::vector<int> at(5, -1);
  const std::function<void(int)> place = [&](int station) {
    if (station == 5) {
      double sum = 0;
      for (int i = 0; i < 5; ++i)
        for (int k = 0; k < i; ++k) sum += flows(i, k) * std::abs(at[std::size_t(i)] - at[std::size_t(k)]);
      best = std::min(best, sum);
      return;
    }
    for (int p = 0; p < 5; ++p) {
      if (std::find(at.begin(), at.begin() + station, p) != at.begin() + station) continue;
      at[std::size_t(station)] = p;
      place(station + 1);
      at[std::size_t(station)] = -1;
    }
  };
  place(0);
  EXPECT_NEAR(transport(flows, best_assignment(flows, places)), best, kRounding);
}

TEST(Planning, EdgesOfTheMethods) {
  EXPECT_TRUE(triangular(FlowMatrix::Zero(0, 0)).places.empty());
  EXPECT_EQ(triangular(FlowMatrix::Zero(1, 1)).places.size(), 1U);
  EXPECT_EQ(circle(FlowMatrix::Zero(2, 2)).places.size(), 2U);
  EXPECT_EQ(systematic(3, {}).score, 0);
  // Nine stations are not enumerated, and say so.
  EXPECT_FALSE(triangular(FlowMatrix::Ones(9, 9)).best);
}

}  // namespace
}  // namespace polypod::cell
