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
  EXPECT_NEAR(*median.best, 10, 1e-4);
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
