// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/geometry/hull.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include <random>

namespace polypod {
namespace {

using Vec2 = Eigen::Vector2d;

double side(const Vec2& a, const Vec2& b, const Vec2& p) {
  return (b - a).x() * (p - a).y() - (b - a).y() * (p - a).x();
}

TEST(ConvexHull, HoldsAllPointsAndHasCornersOfThemAlone) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> at(-1, 1);
  for (int run = 0; run < 200; ++run) {
    std::vector<Vec2> points;
    for (int k = 0; k < 3 + run % 40; ++k) points.emplace_back(at(random), at(random));
    const std::vector<Vec2> hull = convex_hull(points);
    ASSERT_GE(hull.size(), 3U);
    for (std::size_t k = 0; k < hull.size(); ++k) {
      const Vec2 &a = hull[k], &b = hull[(k + 1) % hull.size()], &c = hull[(k + 2) % hull.size()];
      EXPECT_GT(side(a, b, c), 0) << "counterclockwise";
      EXPECT_NE(std::find(points.begin(), points.end(), a), points.end());
      for (const Vec2& p : points) EXPECT_GE(side(a, b, p), -1e-12);
    }
  }
}

TEST(ConvexHull, PointsOnSidesAndTwiceThereAreNoCorners) {
  const std::vector<Vec2> square{{0, 0}, {1, 0}, {1, 1}, {0, 1}, {0.5, 0}, {1, 0.5}, {0.5, 0.5}, {0, 0}};
  EXPECT_EQ(convex_hull(square), (std::vector<Vec2>{{0, 0}, {1, 0}, {1, 1}, {0, 1}}));
  // A turn below the least is none.
  EXPECT_EQ(convex_hull({{0, 0}, {1, 0}, {1, 1}, {0, 1}, {0.5, -1e-9}}, 1e-6).size(), 4U);
  EXPECT_EQ(convex_hull({{0, 0}, {1, 0}, {1, 1}, {0, 1}, {0.5, -1e-3}}, 1e-6).size(), 5U);
}

TEST(ConvexHull, OfFewPoints) {
  EXPECT_TRUE(convex_hull({}).empty());
  EXPECT_LE(convex_hull({{1, 2}}).size(), 1U);
  EXPECT_EQ(convex_hull({{0, 0}, {1, 1}, {0.5, 0.5}}).size(), 2U);
}

}  // namespace
}  // namespace polypod
