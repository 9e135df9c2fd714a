// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Distances of bodies against closed forms and points by the million, and what the layout finds.
#include "polypod/cell/layout.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "cells.hpp"
#include "paths.hpp"
#include "polypod/cell/judge.hpp"

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

// The plate of the delta's base hangs at 1456 mm, 250 mm about 1400, 1110 mm: a post through it was found by nothing.
TEST(Layout, TheBaseOfAMachineIsABody) {
  const auto cell = read(test::source("cells/kozubik/cell.toml"));
  ASSERT_TRUE(cell);
  const Motions m = motions(*cell);
  const auto with_post = [&](double x, double y, double bottom, double top, const std::vector<std::string>& on = {}) {
    Cell c = *cell;
    c.bodies.push_back({"post", "post", {x, y, (bottom + top) / 2}, {0.04, 0.04, top - bottom}, 0, false});
    c.machines[0].mounted_on = on;
    const Layout l = layout(c, m);
    return std::any_of(l.problems.begin(), l.problems.end(), [](const Problem& p) {
      return p.detail.find("the base of delta runs into post") != std::string::npos;
    });
  };
  EXPECT_TRUE(with_post(1.4, 1.11, 1.40, 1.6));
  EXPECT_TRUE(with_post(1.4 + 0.2, 1.11, 1.45, 2.0));
  EXPECT_TRUE(with_post(1.4, 1.11, 1.465, 1.6)) << "its edge is 20 mm thick";
  EXPECT_FALSE(with_post(1.4, 1.11, 1.467, 1.6)) << "above it";
  EXPECT_FALSE(with_post(1.4 + 0.29, 1.11, 1.45, 2.0)) << "beside it";
  EXPECT_FALSE(with_post(1.4, 1.11, 1.45, 2.0, {"post"})) << "it carries the machine";
  // The column of the arm stands on what its foot touches; a body higher up is in its way.
  Cell c = *cell;
  c.bodies.push_back({"beam", "beam", {1.08, 0.61, 1.0}, {0.04, 0.6, 0.04}, 0, false});
  const Layout l = layout(c, m);
  EXPECT_TRUE(std::any_of(l.problems.begin(), l.problems.end(), [](const Problem& p) {
    return p.detail.find("the base of arm runs into beam") != std::string::npos;
  }));
  // What no body stands for is named.
  CellQuestion question;
  question.settings.seconds = 1;
  question.plan = false;
  const CellResult r = judge_cell(*cell, question);
  EXPECT_TRUE(std::any_of(r.not_judged.begin(), r.not_judged.end(), [](const std::string& t) {
    return t ==
           "collisions of delta with more than links of one diameter and its base, a disc of 520 mm: drives, "
           "gears, cables and hoses are no bodies";
  }));
}

// What machines pass, narrowest first; a fence that stands farther off leaves so much more.
TEST(Layout, TheNarrowestGapOfEachPairIsKept) {
  auto cell = read(test::source("cells/kozubik/cell.toml"));
  ASSERT_TRUE(cell);
  const Motions m = motions(*cell);
  const Layout l = layout(*cell, m);
  ASSERT_FALSE(l.gaps.empty());
  EXPECT_TRUE(
      std::is_sorted(l.gaps.begin(), l.gaps.end(), [](const Gap& a, const Gap& b) { return a.distance < b.distance; }));
  EXPECT_EQ(l.gaps.front().distance, l.least_distance);
  const auto front =
      std::find_if(l.gaps.begin(), l.gaps.end(), [](const Gap& g) { return g.machine == "arm" && g.what == "front"; });
  ASSERT_NE(front, l.gaps.end());
  EXPECT_EQ(front->kind, "fence");
  EXPECT_GT(front->distance, 0);
  EXPECT_LT(front->distance, 0.03);
  // A fence 10 mm farther away leaves 10 mm more.
  for (Guard& g : cell->guards) {
    if (g.name != "front") continue;
    g.from.y() -= 0.01;
    g.to.y() -= 0.01;
  }
  const Layout farther = layout(*cell, m);
  const auto there = std::find_if(farther.gaps.begin(), farther.gaps.end(),
                                  [](const Gap& g) { return g.machine == "arm" && g.what == "front"; });
  ASSERT_NE(there, farther.gaps.end());
  EXPECT_NEAR(there->distance, front->distance + 0.01, 1e-6);
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
  const Layout high = layout(*cell, m);
  EXPECT_FALSE(finds(high, "collision", "empty) runs into items on B")) << "it works there";
  EXPECT_TRUE(finds(high, "collision", "delta (home) runs into items on A")) << "there it only waits";
}

// The bottom of a box that hangs from a tool at 1000 mm is at 975 mm; on the way from P to Q2 the tool sinks a little.
TEST(Layout, WhatIsCarriedRunsIntoBodies) {
  std::string text = test::kCrossing;
  for (std::size_t at = 0; (at = text.find("KEEPS")) != std::string::npos;) text.replace(at, 5, "false");
  auto cell = from_text(text, "crossing.toml");
  ASSERT_TRUE(cell);
  for (Machine& m : cell->machines) m.body = 0.004;  // the tool alone clears the body
  const Motions m = motions(*cell);
  const auto with_top_at = [&](double top) {
    Cell c = *cell;
    c.bodies.push_back({"wall", "wall", {0, 0.075, top - 0.05}, {0.02, 0.02, 0.1}, 0, false});
    return layout(c, m);
  };
  const Layout high = with_top_at(0.97), low = with_top_at(0.90);
  EXPECT_TRUE(finds(high, "collision", "the box in one (there) runs into wall"));
  EXPECT_FALSE(finds(high, "collision", "mm into wall")) << "the machine itself is over it";
  EXPECT_FALSE(finds(low, "collision", "wall"));
}

TEST(Layout, ContainersAtRestTouchNothingButTheirPlace) {
  auto cell = from_text(test::kPicking, "small.toml");
  ASSERT_TRUE(cell);
  cell->tasks.clear();
  Motions none;  // nothing moves
  none.home.resize(1);
  none.stands.assign(1, std::vector<std::vector<Stand>>(1));
  none.picks.resize(1);
  EXPECT_TRUE(layout(*cell, none).problems.empty());
  // Boxes of 100 mm stand at x = 740 and 860, y = 250, from 875 to 925 mm.
  Cell beside = *cell, on = *cell, in = *cell, own = *cell;
  beside.bodies.push_back({"post", "post", {0.8, 0.25, 0.9}, {0.02, 0.02, 0.2}, 0, false});
  on.bodies.push_back({"table", "table", {0.8, 0.3, 0.8375}, {0.4, 0.2, 0.075}, 0, false});
  in.bodies.push_back({"table", "table", {0.8, 0.3, 0.8385}, {0.4, 0.2, 0.075}, 0, false});
  EXPECT_TRUE(layout(beside, none).problems.empty()) << "they touch it";
  EXPECT_TRUE(layout(on, none).problems.empty()) << "they stand on it";
  EXPECT_TRUE(finds(layout(in, none), "collision", "the box in slot 1 of holder runs into table"));
  own.spots[0].size = {0.3, 0.15, 0.05};
  own.spots[0].middle = {0.8, 0.3, 0.88};
  EXPECT_TRUE(layout(own, none).problems.empty()) << "they stand in their holder";
  Cell two = *cell;
  two.spots.push_back(two.spots[0]);
  two.spots[1].name = "other";
  for (Vec3& slot : two.spots[1].slots) slot.x() += 0.01;
  EXPECT_TRUE(
      finds(layout(two, none), "collision", "the box in slot 1 of holder runs into the box in slot 1 of other"));
}

/// The seed's cell with a change.
template <class Change>
Layout seed_with(Change&& change) {
  auto cell = read(test::source("cells/kozubik/cell.toml"));
  EXPECT_TRUE(cell);
  change(*cell);
  return layout(*cell, motions(*cell));
}

// Taken in the middle of its height, a tin has the gripper between its neighbours: 25 deg below the horizontal it meets
// them. At the rim it passes over.
TEST(Layout, NeighboursAreInTheWayOfTheHand) {
  const Layout l = seed_with([](Cell& cell) { cell.containers[0].grip = 0.06; });
  EXPECT_TRUE(finds(l, "collision", "arm (fetch) comes"));
  EXPECT_TRUE(finds(l, "collision", "into the tin in slot"));
}

// Raised by less than its height, a tin is drawn through the others.
TEST(Layout, ATinMustComeOverTheOthers) {
  const Layout l = seed_with([](Cell& cell) {
    for (Spot& s : cell.spots)
      if (s.name == "pallet") s.clearance = 0.02;
  });
  EXPECT_TRUE(finds(l, "collision", "the tin in arm (return) runs into the tin in slot"));
  EXPECT_TRUE(finds(l, "collision", "the tin in arm (fetch) runs into pallet"));
}

// Of a place with many slots not every pair is gone through, and the answer says so.
TEST(Layout, WhatIsLeftOutIsSaid) {
  EXPECT_TRUE(seed_with([](Cell&) {}).complete);
  EXPECT_FALSE(seed_with([](Cell& cell) {
                 for (Spot& s : cell.spots)
                   if (s.name == "pallet")
                     while (s.slots.size() < 21) s.slots.push_back(s.slots.back());
               }).complete);
}

// Without drawing in, the arm swings a tin through the fence at the front.
TEST(Layout, FencesAreBodies) {
  const Layout l = seed_with([](Cell& cell) {
    for (Machine& m : cell.machines) m.folds = false;
  });
  EXPECT_TRUE(finds(l, "collision", "into front"));
}

TEST(Layout, BodiesStandOnTheFloorAndInNoFence) {
  const auto with = [](const Body& body) { return seed_with([&](Cell& cell) { cell.bodies.push_back(body); }); };
  EXPECT_TRUE(finds(with({"box", "table", {2.4, 1.6, 0.4}, {0.3, 0.3, 0.8}, 0, false}), "collision",
                    "box stands in the fence right"));
  EXPECT_FALSE(finds(with({"box", "table", {2.55, 1.2, 0.4}, {0.3, 0.3, 0.8}, 0, false}), "collision", "box"))
      << "beside it";
  EXPECT_TRUE(finds(with({"box", "table", {2.0, 1.8, 0}, {0.3, 0.3, 1.2}, 0, false}), "collision",
                    "box reaches 600.0 mm below the floor"));
  const Layout many = seed_with([](Cell& cell) {
    for (int k = 0; k < 30; ++k)
      cell.bodies.push_back({"b" + std::to_string(k), "table", {2.0, 1.8, 0.5}, {0.1, 0.1, 0.1}, 0, false});
  });
  EXPECT_TRUE(finds(many, "collision", "335 more of bodies at rest")) << "30 bodies are 435 pairs";
}

TEST(Reach, ContainersArePutUprightAndEmptiedUpsideDown) {
  auto cell = read(test::source("cells/kozubik/cell.toml"));
  ASSERT_TRUE(cell);
  const auto says = [](const Cell& c, const std::string& text) {
    const Motions m = motions(c);
    return std::any_of(m.problems.begin(), m.problems.end(),
                       [&](const Problem& p) { return p.kind == "tilt" && p.detail.find(text) != std::string::npos; });
  };
  EXPECT_FALSE(says(*cell, ""));
  Cell steep = *cell, level = *cell;
  for (Spot& s : steep.spots)
    if (s.name == "pallet") s.pitch += 10 * std::acos(-1.0) / 180;
  EXPECT_TRUE(says(steep, "arm (fetch) puts the tin from pallet into holder tilted by 10 deg"));
  for (Spot& s : level.spots)
    if (s.name == "pouring") s.roll = 0;
  EXPECT_TRUE(says(level, "arm (fetch) tilts the tin at pouring by 25 deg, and nothing falls out"));
}

TEST(Reach, AMachineThatFoldsStopsTwiceOnItsWay) {
  const auto cell = read(test::source("cells/kozubik/cell.toml"));
  ASSERT_TRUE(cell);
  Machine m = cell->machines[1];
  machine::JointVector home(6), a(6), b(6);
  home << 0, -2, 2, 0, 0.5, 0;
  a << 1, -1, 1, 0, 0, 0;
  b << -1, -1.5, 1, 0, 1, 0;
  const auto way = stops(m, home, a, b);
  ASSERT_EQ(way.size(), 3U);
  EXPECT_EQ(way[0][0], 1);
  EXPECT_EQ(way[0][1], -2);
  EXPECT_EQ(way[1][0], -1);
  EXPECT_EQ(way[1][4], 0.5);
  EXPECT_EQ(way[2], b);
  EXPECT_DOUBLE_EQ(way_time(m, home, a, b),
                   joint_time(m, a, way[0]) + joint_time(m, way[0], way[1]) + joint_time(m, way[1], b));
  EXPECT_EQ(stops(m, home, home, b).size(), 2U) << "from home it need not draw in";
  m.folds = false;
  EXPECT_EQ(stops(m, home, a, b).size(), 1U);
  EXPECT_DOUBLE_EQ(way_time(m, home, a, b), joint_time(m, a, b));
}

TEST(Reach, OnlyArmsFold) {
  std::string text = test::kPicking;
  text.replace(text.find("lift_mm = 40"), 12, "lift_mm = 40\nfolds = true");
  const auto cell = from_text(text, "small.toml");
  ASSERT_FALSE(cell);
  EXPECT_EQ(cell.error().id, "CE106");
}

TEST(Judge, DefaultsThatCountAreNamed) {
  const auto cell = from_text(test::kPicking, "small.toml");
  ASSERT_TRUE(cell);
  CellQuestion question;
  question.settings.seconds = 5;
  const auto says = [](const CellResult& r, const std::string& text) {
    return std::any_of(r.assumed.begin(), r.assumed.end(),
                       [&](const std::string& a) { return a.find(text) != std::string::npos; });
  };
  const CellResult r = judge_cell(*cell, question);
  EXPECT_TRUE(says(r, "box: grip_mm = 25, half of its height, by default"));
  EXPECT_TRUE(says(r, "body_diameter_mm = 100"));
  EXPECT_TRUE(says(r, "tool_speed_mm_per_s = 5000"));
  EXPECT_FALSE(says(r, "grip_s")) << "it is given";
  EXPECT_FALSE(says(r, "joint_speed")) << "a delta that picks moves by planned cycles";
  std::string text = test::kPicking;
  text.replace(text.find("height_mm = 50"), 14, "height_mm = 50\ngrip_mm = 25");
  text.replace(text.find("lift_mm = 40"), 12, "lift_mm = 40\nbody_diameter_mm = 100");
  const auto given = from_text(text, "small.toml");
  ASSERT_TRUE(given);
  const CellResult g = judge_cell(*given, question);
  EXPECT_FALSE(says(g, "grip_mm"));
  EXPECT_FALSE(says(g, "body_diameter_mm"));
}

}  // namespace
}  // namespace polypod::cell
