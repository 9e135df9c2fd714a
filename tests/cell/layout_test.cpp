// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Distances of bodies against closed forms and points by the million, and what the layout finds.
#include "polypod/cell/layout.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "paths.hpp"

namespace polypod::cell {
namespace {

TEST(Layout, DistanceOfASegmentFromABox) {
  const Solid box{"box", "", {0, 0, 0}, {2, 4, 6}, 0, false};
  EXPECT_NEAR(distance({3, 0, 0}, {3, 1, 1}, box), 2, 1e-9);
  EXPECT_NEAR(distance({5, 0, 0}, {-5, 0, 0}, box), 0, 1e-9) << "through it";
  EXPECT_NEAR(distance({2, 3, 4}, {5, 5, 5}, box), std::sqrt(3.0), 1e-6) << "its corner";
  // Past an edge: the line x + y = 6 in the plane z = 0 is 3 / sqrt 2 from the edge (1, 2).
  EXPECT_NEAR(distance({6, 0, 0}, {0, 6, 0}, box), 3 / std::sqrt(2.0), 1e-6);
  // Turned by 90 deg the sides change their places.
  EXPECT_NEAR(distance({3, 0, 0}, {3, 1, 1}, {"", "", {0, 0, 0}, {2, 4, 6}, std::acos(-1.0) / 2, false}), 1, 1e-9);
}

TEST(Layout, DistanceAgreesWithPointsOfBoth) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> uniform(-2, 2);
  for (int n = 0; n < 30; ++n) {
    const Solid s{"", "", {uniform(random), uniform(random), uniform(random)}, {0.5, 1, 0.3}, uniform(random), false};
    const Vec3 a(uniform(random), uniform(random), uniform(random)),
        b(uniform(random), uniform(random), uniform(random));
    // From points along the segment to the box: the nearest point by clamping in the box's frame.
    double best = 1e9;
    for (int k = 0; k <= 2000; ++k) {
      const Vec3 p = a + (b - a) * (k / 2000.0) - s.middle;
      const double c = std::cos(s.turn), m = std::sin(s.turn);
      const Vec3 q(c * p.x() + m * p.y(), -m * p.x() + c * p.y(), p.z());
      const Vec3 nearest = q.cwiseMax(-s.size / 2).cwiseMin(s.size / 2);
      best = std::min(best, (q - nearest).norm());
    }
    EXPECT_NEAR(distance(a, b, s), best, 2e-3);
    EXPECT_LE(distance(a, b, s), best + 1e-9);
  }
}

TEST(Layout, BoxesThatReachIntoEachOther) {
  const Solid a{"", "", {0, 0, 0}, {2, 2, 2}, 0, false};
  EXPECT_NEAR(overlap(a, {"", "", {1.5, 0, 0}, {2, 2, 2}, 0, false}), 0.5, 1e-12);
  EXPECT_NEAR(overlap(a, {"", "", {2, 0, 0}, {2, 2, 2}, 0, false}), 0, 1e-12) << "they touch";
  EXPECT_LT(overlap(a, {"", "", {0, 0, 3}, {2, 2, 2}, 0, false}), 0);
  // A square on its corner reaches sqrt 2 along x: 1 + sqrt 2 - 2.3.
  EXPECT_NEAR(overlap(a, {"", "", {2.3, 0, 0}, {2, 2, 2}, std::acos(-1.0) / 4, false}), 1 + std::sqrt(2.0) - 2.3,
              1e-12);
}

TEST(Layout, TheSeedsCellCollidesNowhere) {
  const auto cell = read(test::source("cells/kozubik/cell.toml"));
  ASSERT_TRUE(cell);
  const Motions m = motions(*cell);
  const Layout l = layout(*cell, m);
  for (const Problem& p : l.problems) ADD_FAILURE() << p.kind << ": " << p.detail;
  EXPECT_GT(l.positions, 1000);
  // The machines share the space over the holder, and only there.
  ASSERT_FALSE(l.conflicts.empty());
  for (const Conflict& c : l.conflicts) EXPECT_EQ(c.zone, "over the holder");
}

TEST(Layout, WithoutItsInterlockTheSeedsCellCollides) {
  auto cell = read(test::source("cells/kozubik/cell.toml"));
  ASSERT_TRUE(cell);
  for (Spot& s : cell->spots) s.zone.clear();
  const Layout l = layout(*cell, motions(*cell));
  bool found = false;
  for (const Problem& p : l.problems)
    found |= p.kind == "collision" && p.detail.find("delta (fill)") != std::string::npos &&
             p.detail.find("arm (empty)") != std::string::npos;
  EXPECT_TRUE(found);
}

TEST(Layout, WhatStandsInTheWayIsFound) {
  auto cell = read(test::source("cells/kozubik/cell.toml"));
  ASSERT_TRUE(cell);
  cell->bodies.push_back({"post", "post", {1.4, 0.85, 1.2}, {0.05, 0.05, 0.8}, 0, false});
  cell->bodies.push_back({"wide", "table", {1.4, 4, 0.4}, {0.9, 0.9, 0.8}, 0, true});
  const Layout l = layout(*cell, motions(*cell));
  bool post = false, door = false;
  for (const Problem& p : l.problems) {
    post |= p.kind == "collision" && p.detail.find("post") != std::string::npos;
    door |= p.kind == "door" && p.detail.find("wide is 900 mm wide") != std::string::npos;
  }
  EXPECT_TRUE(post);
  EXPECT_TRUE(door);
}

bool finds(const Layout& l, const std::string& kind, const std::string& text) {
  return std::any_of(l.problems.begin(), l.problems.end(),
                     [&](const Problem& p) { return p.kind == kind && p.detail.find(text) != std::string::npos; });
}

// Tins of 120 mm that are taken at their rim stand from 795 to 915 mm in the pallet (taken at 915 mm).
TEST(Layout, ContainersStandWhereTheToolTakesThem) {
  const auto cell = read(test::source("cells/kozubik/cell.toml"));
  ASSERT_TRUE(cell);
  const std::vector<StandingContainer> all = standing_containers(*cell);
  ASSERT_EQ(all.size(), 18U + 2 + 1);  // pallet, holder, opening; none where they are emptied
  EXPECT_NEAR(all[0].bottom.z(), 0.795, 1e-9);
}

// A belt that lies on an obstacle's top is clear of it; the items on the belt are not.
TEST(Layout, ItemsOnBeltsAreInTheWay) {
  auto cell = read(test::source("cells/kozubik/cell.toml"));
  ASSERT_TRUE(cell);
  const Motions m = motions(*cell);
  EXPECT_FALSE(finds(layout(*cell, m), "collision", "items on B"));
  cell->items[0].height = 0.25;  // 1.2 m: as high as the tins that are poured out
  EXPECT_FALSE(finds(layout(*cell, m), "collision", "empty) reaches into items on B")) << "it works there";
}

}  // namespace
}  // namespace polypod::cell
