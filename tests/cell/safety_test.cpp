// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Distances of guards against the formulas of the standards, worked by hand in mm.
#include "polypod/cell/safety.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

namespace polypod::cell {
namespace {

constexpr double kRounding = 1e-12;

TEST(Safety, LightCurtainsByIso13855) {
  // d = 30 mm, T = 0.1 s: 2000 x 0.1 + 8 (30 - 14) = 328 mm.
  EXPECT_NEAR(*curtain_distance(0.1, 0.030), 0.328, kRounding);
  // T = 0.3 s: 600 + 128 > 500, so 1600 x 0.3 + 128 = 608 mm.
  EXPECT_NEAR(*curtain_distance(0.3, 0.030), 0.608, kRounding);
  // T = 0.2 s, d = 30: 528 > 500, 1600 x 0.2 + 128 = 448 < 500: 500 mm.
  EXPECT_NEAR(*curtain_distance(0.2, 0.030), 0.500, kRounding);
  // Never below 100 mm, and d below 14 mm adds nothing.
  EXPECT_NEAR(*curtain_distance(0.01, 0.010), 0.100, kRounding);
  EXPECT_NEAR(*curtain_distance(0.1, 0.014), 0.200, kRounding);
  // 40 < d <= 70 mm: 1600 T + 850 mm.
  EXPECT_NEAR(*curtain_distance(0.2, 0.050), 1.170, kRounding);
  EXPECT_FALSE(curtain_distance(0.2, 0.080));
}

TEST(Safety, ReachingOverLightCurtains) {
  // Table 1 as it stands in the manual of Schmersal's SLC 420: a = 1400, b = 900: 1200 mm; 1600 x 0.334 + 1200.
  EXPECT_NEAR(*curtain_over_distance(0.334, 1.4, 0.9), 0.5344 + 1.2, kRounding);
  // Between rows the larger (1600: 450, 1400: 0), between columns the lower edge (1900 as 1800).
  EXPECT_NEAR(*curtain_over_distance(0.334, 1.45, 1.9), 0.5344 + 0.45, kRounding);
  // K = 2000 mm/s where that gives up to 500 mm: 2000 x 0.02 + 250 = 290 mm (a = 2500, b = 2000).
  EXPECT_NEAR(*curtain_over_distance(0.02, 2.5, 2.0), 0.290, kRounding);
  // 2000 x 0.1 + 400 = 600 > 500: 1600 x 0.1 + 400 = 560 mm (a = 2200, b = 2000).
  EXPECT_NEAR(*curtain_over_distance(0.1, 2.2, 2.0), 0.560, kRounding);
  EXPECT_EQ(*curtain_over_distance(0.334, 1.4, 2.0), 0) << "nobody reaches over it";
  EXPECT_FALSE(curtain_over_distance(0.334, 1.0, 0.89));
}

// The tables by their columns, from the highest hazard to the floor: each entry, and no distance that grows with the
// guard.
TEST(Safety, EveryEntryOfTheTables) {
  struct Column {
    int guard;                      // mm
    std::array<int, 15> distances;  // mm
  };
  constexpr std::array<int, 15> kHazards{2700, 2600, 2400, 2200, 2000, 1800, 1600, 1400,
                                         1200, 1000, 800,  600,  400,  200,  0};
  constexpr std::array<Column, 10> kFences{
      {{1000, {0, 900, 1100, 1300, 1400, 1500, 1500, 1500, 1500, 1500, 1500, 1400, 1400, 1200, 1100}},
       {1200, {0, 800, 1000, 1200, 1300, 1400, 1400, 1400, 1400, 1400, 1300, 1300, 1200, 900, 500}},
       {1400, {0, 700, 900, 1000, 1100, 1100, 1100, 1100, 1100, 1000, 900, 800, 400, 0, 0}},
       {1600, {0, 600, 800, 900, 900, 900, 900, 900, 900, 800, 600, 0, 0, 0, 0}},
       {1800, {0, 600, 700, 800, 800, 800, 800, 800, 700, 0, 0, 0, 0, 0, 0}},
       {2000, {0, 500, 600, 600, 600, 600, 500, 0, 0, 0, 0, 0, 0, 0, 0}},
       {2200, {0, 400, 400, 400, 400, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}},
       {2400, {0, 300, 300, 300, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}},
       {2500, {0, 100, 100, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}},
       {2700, {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}}}};
  const auto each_entry = [](const auto& columns, const std::array<int, 15>& hazards, const auto& check) {
    for (const Column& column : columns) {
      for (std::size_t k = 0; k < hazards.size(); ++k) {
        SCOPED_TRACE(fmt::format("guard of {} mm, hazard at {} mm", column.guard, hazards[k]));
        check(1e-3 * hazards[k], 1e-3 * column.guard, 1e-3 * column.distances[k]);
      }
    }
  };
  each_entry(kFences, kHazards, [](double hazard, double guard, double distance) {
    EXPECT_NEAR(*reach_over_distance(hazard, guard), distance, kRounding);
  });
  constexpr std::array<int, 15> kBehind{2600, 2500, 2400, 2200, 2000, 1800, 1600, 1400,
                                        1200, 1000, 800,  600,  400,  200,  0};
  constexpr std::array<Column, 12> kCurtains{
      {{900, {0, 400, 550, 800, 950, 1100, 1150, 1200, 1200, 1200, 1150, 1050, 900, 600, 0}},
       {1000, {0, 400, 550, 750, 950, 1100, 1150, 1200, 1200, 1150, 1050, 950, 700, 0, 0}},
       {1100, {0, 350, 550, 750, 850, 950, 1100, 1100, 1100, 1050, 950, 750, 0, 0, 0}},
       {1200, {0, 300, 500, 700, 850, 950, 1000, 1000, 1000, 950, 800, 550, 0, 0, 0}},
       {1300, {0, 300, 450, 650, 800, 850, 900, 900, 850, 750, 500, 0, 0, 0, 0}},
       {1400, {0, 300, 450, 650, 750, 800, 850, 850, 800, 700, 450, 0, 0, 0, 0}},
       {1600, {0, 300, 400, 600, 700, 750, 750, 650, 0, 0, 0, 0, 0, 0, 0}},
       {1800, {0, 300, 400, 550, 550, 550, 450, 0, 0, 0, 0, 0, 0, 0, 0}},
       {2000, {0, 250, 300, 400, 400, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}},
       {2200, {0, 150, 250, 250, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}},
       {2400, {0, 100, 100, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}},
       {2600, {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}}}};
  each_entry(kCurtains, kBehind, [](double hazard, double guard, double distance) {
    constexpr double kStop = 1;  // s: K is 1.6 m/s, whatever C is
    EXPECT_NEAR(*curtain_over_distance(kStop, hazard, guard), distance > 0 ? 1.6 * kStop + distance : 0, kRounding);
  });
  for (int hazard = 0; hazard <= 2700; hazard += 50) {
    double fence = 1e9, curtain = 1e9;
    for (int guard = 1000; guard <= 2700; guard += 50) {
      const double of_fence = *reach_over_distance(1e-3 * hazard, 1e-3 * guard);
      const double of_curtain = *curtain_over_distance(1, 1e-3 * hazard, 1e-3 * guard);
      EXPECT_LE(of_fence, fence) << hazard << ' ' << guard;
      EXPECT_LE(of_curtain, curtain) << hazard << ' ' << guard;
      fence = of_fence;
      curtain = of_curtain;
    }
  }
}

// ISO 13857, Table 4, for slots, squares and rounds at the upper end of each row.
TEST(Safety, EveryRowOfTheOpenings) {
  struct Row {
    double opening, slot, square, round;  // mm
  };
  for (const Row& row :
       {Row{4, 2, 2, 2}, Row{6, 10, 5, 5}, Row{8, 20, 15, 5}, Row{10, 80, 25, 20}, Row{12, 100, 80, 80},
        Row{20, 120, 120, 120}, Row{30, 850, 120, 120}, Row{40, 850, 200, 120}, Row{120, 850, 850, 850}}) {
    SCOPED_TRACE(row.opening);
    EXPECT_NEAR(*reach_through_distance("slot", 1e-3 * row.opening), 1e-3 * row.slot, kRounding);
    EXPECT_NEAR(*reach_through_distance("square", 1e-3 * row.opening), 1e-3 * row.square, kRounding);
    EXPECT_NEAR(*reach_through_distance("round", 1e-3 * row.opening), 1e-3 * row.round, kRounding);
  }
  EXPECT_FALSE(reach_through_distance("round", 0.1201));
}

Guard fence(const std::string& name, const Vec3& from, const Vec3& to) {
  Guard g;
  g.name = name;
  g.from = from;
  g.to = to;
  g.height = 2.2;
  return g;
}

TEST(Safety, PeopleWalkInWhereNoGuardStands) {
  const std::vector<Swept> space{{{1, 1, 1}, 0.1, "arm"}, {{1.2, 1, 1}, 0.1, "arm"}};
  Cell cell;
  EXPECT_EQ(way_in(cell, space), "from the front, the right, the back, the left");
  cell.guards = {fence("front", {0, 0, 0}, {3, 0, 0}), fence("right", {3, 0, 0}, {3, 3, 0}),
                 fence("back", {3, 3, 0}, {0, 3, 0})};
  EXPECT_EQ(way_in(cell, space), "from the left");
  cell.guards.push_back(fence("left", {0, 3, 0}, {0, 0, 0}));
  EXPECT_EQ(way_in(cell, space), "");
  // A gap of 100 mm lets nobody through, one of 300 mm in a corner does.
  cell.guards[3].to.y() = 0.1;
  EXPECT_EQ(way_in(cell, space), "");
  cell.guards[3].to.y() = 0.3;
  EXPECT_TRUE(way_in(cell, space).starts_with("near ")) << way_in(cell, space);
  // It is told where it is, not at a corner that the way passes: 300 mm in the back fence beside the right one.
  cell.guards[3].to.y() = 0;
  cell.guards[2].from.x() = 2.7;
  double x = 0, y = 0;
  ASSERT_EQ(std::sscanf(way_in(cell, space).c_str(), "near %lf, %lf", &x, &y), 2) << way_in(cell, space);
  EXPECT_NEAR(x, 2850, 200);
  EXPECT_NEAR(y, 3000, 100);
  cell.guards[2].from.x() = 3;
  cell.guards[3].to.y() = 0.3;
  // What is higher than people reach needs no guard (ISO 13857, 4.2.1).
  EXPECT_EQ(way_in(cell, {{{1, 1, 3}, 0.1, "arm"}}), "");
  // Far apart, the squares are larger, and guards stay tight.
  cell.guards[3].to.y() = 0;
  for (Guard& g : cell.guards) {
    g.from *= 30;
    g.to *= 30;
  }
  EXPECT_EQ(way_in(cell, space), "");
}

TEST(Safety, ALowCurtainIsNoGuard) {
  Cell cell;
  cell.open_sides = "walls";
  Guard g = fence("front", {0, 0, 0}, {2, 0, 0});
  g.kind = Guard::Kind::curtain;
  g.height = 0.1;
  cell.guards.push_back(g);
  const Safety low = safety(cell, {{{1, 5, 1}, 0.1, "arm"}});
  ASSERT_EQ(low.problems.size(), 1U);
  EXPECT_NE(low.problems[0].detail.find("below 900 mm"), std::string::npos) << low.problems[0].detail;
  // At 1800 mm a hazard up to 1.4 m is not reached over it, one up to 1.7 m is: 550 mm more than K T.
  cell.guards[0].height = 1.8;
  EXPECT_TRUE(safety(cell, {{{1, 0.5, 1.3}, 0.1, "arm"}}).problems.empty());
  EXPECT_EQ(safety(cell, {{{1, 0.5, 1.6}, 0.1, "arm"}}).problems.size(), 1U);
  // A fence of 1.2 m needs another measure, however far it stands.
  cell.guards[0] = fence("front", {0, 0, 0}, {2, 0, 0});
  cell.guards[0].height = 1.2;
  EXPECT_EQ(safety(cell, {{{1, 5, 1}, 0.1, "arm"}}).problems.size(), 1U);
}

TEST(Safety, ScannersByIso13855) {
  // H = 300 mm: 1600 x 0.5 + 1200 - 120 = 1880 mm; H = 1000 mm: C is not below 850 mm.
  EXPECT_NEAR(*scanner_distance(0.5, 0.300, 0.070), 1.880, kRounding);
  EXPECT_NEAR(*scanner_distance(0.5, 1.000, 0.070), 1.650, kRounding);
  // 15 (70 - 50) = 300 mm is the least height.
  EXPECT_FALSE(scanner_distance(0.5, 0.299, 0.070));
  EXPECT_FALSE(scanner_distance(0.5, 1.1, 0.030));
}

TEST(Safety, ReachingOverAndThrough) {
  EXPECT_NEAR(*reach_over_distance(1.4, 1.6), 0.9, kRounding);
  EXPECT_NEAR(*reach_over_distance(1.0, 2.0), 0, kRounding);
  // Between rows the larger value counts, between columns the lower fence: 1300 mm, 1500 mm as 1400 (1100) and 1400.
  EXPECT_NEAR(*reach_over_distance(1.3, 1.5), 1.1, kRounding);
  EXPECT_FALSE(reach_over_distance(1.0, 0.9));
  EXPECT_NEAR(*reach_through_distance("round", 0.006), 0.005, kRounding);
  EXPECT_NEAR(*reach_through_distance("slot", 0.012), 0.100, kRounding);
  EXPECT_NEAR(*reach_through_distance("square", 0.035), 0.200, kRounding);
  EXPECT_NEAR(*reach_through_distance("round", 0.090), 0.850, kRounding);
  EXPECT_FALSE(reach_through_distance("round", 0.130));
}

// The tables rise and fall with the height of the hazard: neither end of a link's heights is the worst.
TEST(Safety, EveryHeightOfAHazardCounts) {
  // ISO 13857, Table 2, fence of 1200 mm: 900 mm at 200, 1400 at 1000 to 1800, 1300 at 2000, 800 at 2600.
  EXPECT_NEAR(*reach_over_distance(0.2, 0.2, 1.2), 0.9, kRounding);
  EXPECT_NEAR(*reach_over_distance(2.6, 2.6, 1.2), 0.8, kRounding);
  EXPECT_NEAR(*reach_over_distance(0.2, 2.6, 1.2), 1.4, kRounding);
  EXPECT_NEAR(*reach_over_distance(1.9, 2.6, 1.2), 1.4, kRounding) << "1900 mm lies between 1800 and 2000";
  EXPECT_NEAR(*reach_over_distance(2.0, 2.6, 1.2), 1.3, kRounding);
  EXPECT_NEAR(*reach_over_distance(2.61, 2.62, 1.2), 0.8, kRounding) << "within one pair of rows";
  EXPECT_EQ(*reach_over_distance(2.75, 3.0, 1.2), 0) << "above the table nobody reaches";
  EXPECT_FALSE(reach_over_distance(0.2, 2.6, 0.9));
  // ISO 13855, Table 1, curtain of 1800 mm: 0 at 1400, 550 mm at 1800 to 2200 mm, 400 at 2400.
  EXPECT_EQ(*curtain_over_distance(0.3, 1.0, 1.4, 1.8), 0);
  EXPECT_NEAR(*curtain_over_distance(0.3, 1.0, 2.4, 1.8), 0.48 + 0.55, kRounding);
}

// The largest over an interval is that of a scan in steps of a millimetre, whatever the interval and the fence.
TEST(Safety, HeightsAgreeWithAScan) {
  for (const double fence : {1.0, 1.3, 1.4, 1.8, 2.2, 2.45}) {
    for (double low = 0; low < 2.8; low += 0.13) {
      double most = 0;
      for (int k = 0; low + 0.001 * k < 2.9; ++k) {
        const double high = low + 0.001 * k;
        most = std::max(most, *reach_over_distance(high, fence));
        if (k % 37 != 0) continue;
        EXPECT_NEAR(*reach_over_distance(low, high, fence), most, kRounding) << low << " " << high;
      }
    }
  }
}

// A link that stands upright from 0.3 to 2.5 m, 1.05 m behind a fence of 1.4 m: 1100 mm are needed in its middle, 1000
// mm or less at its ends. A sloping link counts from where it is nearest.
TEST(Safety, ALinkIsJudgedOverItsWholeHeight) {
  Cell cell;
  cell.open_sides = "walls";
  Guard g = fence("front", {0, 0, 0}, {2, 0, 0});
  g.height = 1.4;
  cell.guards.push_back(g);
  const Swept low{{1, 1.05, 0.35}, 0.05, "arm", {}}, high{{1, 1.05, 2.45}, 0.05, "arm", {}};
  EXPECT_TRUE(safety(cell, {low, high}).problems.empty());
  const Safety link = safety(cell, {{low.at, 0.05, "arm", high.at}});
  ASSERT_EQ(link.problems.size(), 1U);
  EXPECT_NE(link.problems[0].detail.find("1000 mm from arm, 1100 mm are needed"), std::string::npos)
      << link.problems[0].detail;
  const Safety slope = safety(cell, {{Vec3(1, 3, 0.8), 0.05, "arm", Vec3(1, 0.9, 0.8)}});
  EXPECT_NEAR(slope.guards.at(0).actual, 0.85, kRounding);
}

TEST(Safety, StoppingTimeIsStatedOrFromTheDrives) {
  Machine m;
  m.joint_speed = {4, 2};
  m.joint_acceleration = {10, 4};
  EXPECT_FALSE(stopping_of(m).stated);
  EXPECT_NEAR(stopping_of(m).time, 0.5, kRounding);
  m.stopping = 0.2;
  EXPECT_TRUE(stopping_of(m).stated);
  EXPECT_NEAR(stopping_of(m).time, 0.2, kRounding);
}

// ISO 13854, Table 1.
TEST(Safety, GapsThatCrush) {
  EXPECT_TRUE(crushed_in(0.500).empty());
  EXPECT_EQ(crushed_in(0.499), std::vector<std::string>{"body"});
  EXPECT_EQ(crushed_in(0.110), (std::vector<std::string>{"body", "head", "leg", "foot", "arm"}));
  EXPECT_EQ(crushed_in(0.024).size(), crushing_gaps().size());
}

const Hazard* hazard(const Safety& s, const std::string& zone) {
  for (const Hazard& h : s.hazards)
    if (h.zone == zone && h.kind == "crushing") return &h;
  return nullptr;
}

// Belts at different heights whose bodies overlap in height: the gap is that in plan, 5 mm, not the 70 mm between the
// one's bottom and the other's belt.
TEST(Safety, GapsBetweenBeltsAreThoseOfTheirBodies) {
  Cell cell;
  Conveyor a, b;
  a.name = "A";
  a.at = {0, 0.93, 0.9};
  a.length = 2;
  a.width = 0.4;
  a.frame_width = 0.45;
  a.depth = 0.15;
  b.name = "B";
  b.at = {1, 0, 0.95};
  b.heading = std::acos(-1.0) / 2;
  b.length = 0.7;
  b.width = b.frame_width = 0.18;
  b.depth = 0.12;
  b.onto = "A";
  cell.conveyors = {a, b};
  const Safety beside = safety(cell, {});
  ASSERT_NE(hazard(beside, "B and A"), nullptr);
  EXPECT_NEAR(hazard(beside, "B and A")->gap, 0.005, 1e-6);
  EXPECT_NE(hazard(beside, "B and A")->cause.find("finger"), std::string::npos);
  EXPECT_FALSE(hazard(beside, "B and A")->sampled);
  // Over the other belt: the bottom at 1.02 m is 120 mm above it; 60 mm away across and up, 85 mm.
  cell.conveyors[1].at.z() = 1.14;
  cell.conveyors[1].length = 0.9;
  EXPECT_NEAR(hazard(safety(cell, {}), "B and A")->gap, 0.120, 1e-6);
  cell.conveyors[1].length = 0.645;
  cell.conveyors[1].at.z() = 1.08;
  EXPECT_NEAR(hazard(safety(cell, {}), "B and A")->gap, std::hypot(0.06, 0.06), 1e-6);
}

TEST(Safety, NarrowWaysOfMachinesAreHazards) {
  const Safety s = safety(Cell{}, {},
                          {{"arm", "front", "fence", "arm (empty)", 0.023, {1, 2, 3}},
                           {"arm", "table", "table", "arm (home)", 0.7, {0, 0, 0}}});
  ASSERT_NE(hazard(s, "arm and front"), nullptr);
  EXPECT_EQ(hazard(s, "arm and front")->gap, 0.023);
  EXPECT_TRUE(hazard(s, "arm and front")->sampled);
  EXPECT_NE(hazard(s, "arm and front")->cause.find("arm (empty) passes the fence front near 1000, 2000, 3000 mm"),
            std::string::npos);
  EXPECT_EQ(hazard(s, "arm and table"), nullptr) << "wide enough for a body";
}

/// An arm that stops within 0.3 s behind one guard along x, walls beside it.
Cell behind(Guard g) {
  Cell cell;
  cell.open_sides = "walls";
  Machine m;
  m.name = "arm";
  m.stopping = 0.3;
  cell.machines.push_back(m);
  g.name = "front";
  g.to = {2, 0, 0};
  cell.guards.push_back(g);
  return cell;
}

TEST(Safety, ACurtainTooNearIsAProblemUnlessAMeasureIsStated) {
  Guard g;
  g.kind = Guard::Kind::curtain;
  g.height = 1.8;
  Cell cell = behind(g);
  // 608 mm are needed: the nearest place is 1 m away, or 0.5 m with what is moved.
  EXPECT_TRUE(safety(cell, {{{1, 1, 1}, 0.1, "arm"}}).problems.empty());
  const Safety near = safety(cell, {{{1, 0.7, 1}, 0.1, "arm"}});
  ASSERT_EQ(near.problems.size(), 1U);
  EXPECT_NE(near.problems[0].detail.find("600 mm from arm, 608 mm are needed"), std::string::npos)
      << near.problems[0].detail;
  EXPECT_NEAR(near.guard_distance, 0.608, kRounding);
  cell.guards[0].measure = "a second curtain";
  const Safety measured = safety(cell, {{{1, 0.7, 1}, 0.1, "arm"}});
  EXPECT_TRUE(measured.problems.empty());
  EXPECT_FALSE(measured.guards[0].enough);
}

// ISO 13855: T is the response of the device, of the control and the stopping time together:
// 1.6 m/s (0.3 + 0.02 + 0.05) s + 8 (30 - 14) mm = 720 mm.
TEST(Safety, TimesOfDeviceAndControlCount) {
  Guard g;
  g.kind = Guard::Kind::curtain;
  g.response = 0.02;
  g.height = 2.6;  // nobody reaches over it
  Cell cell = behind(g);
  cell.control_response = 0.05;
  const Safety out = safety(cell, {{{1, 1, 1}, 0.1, "arm"}});
  EXPECT_NEAR(out.guards.at(0).stopping, 0.37, kRounding);
  EXPECT_NEAR(out.guards.at(0).needed, 0.720, kRounding);
}

// A response that is not stated is no response of 0 ms.
TEST(Safety, WhatAGuardRestsOnIsStatedOrNotJudged) {
  Guard g;
  g.name = "curtain";
  g.kind = Guard::Kind::curtain;
  g.height = 2.6;
  Cell cell = behind(g);
  const std::vector<Swept> space{{{1, 1, 1}, 0.1, "arm"}};
  const Safety out = safety(cell, space);
  ASSERT_EQ(out.not_judged.size(), 2U);  // and what reaches beneath it
  for (const char* key : {"response_ms", "control_response_ms", "resolution_mm (30 is taken)"})
    EXPECT_NE(out.not_judged[0].find(key), std::string::npos) << out.not_judged[0];
  cell.control_response_given = true;
  cell.guards[0].response_given = cell.guards[0].resolution_given = true;
  ASSERT_EQ(safety(cell, space).not_judged.size(), 1U);
  EXPECT_NE(safety(cell, space).not_judged[0].find("beneath"), std::string::npos);
}

// A fence of 2 m with round openings of 30 mm: 120 mm (ISO 13857, Table 4) from the surface of what is moved.
TEST(Safety, OpeningsCountFromTheSurfaceOfWhatIsMoved) {
  Guard g;
  g.height = 2;
  g.opening = 0.030;
  g.opening_height = 1;
  const Cell cell = behind(g);
  EXPECT_TRUE(safety(cell, {{{1, 0.15, 1}, 0.01, "arm"}}).problems.empty());
  const Safety near = safety(cell, {{{1, 0.15, 1}, 0.10, "arm"}});
  ASSERT_EQ(near.guards.size(), 1U);
  EXPECT_FALSE(near.guards[0].enough);
  EXPECT_NE(near.guards[0].note.find("50 mm away, 120 mm are needed"), std::string::npos) << near.guards[0].note;
  // Out of an arm's reach up or down through the opening: with its whole surface, of which the top is 0.85 m below.
  EXPECT_TRUE(safety(cell, {{{1, 0.15, 0.04}, 0.10, "arm"}}).guards[0].enough);
  EXPECT_FALSE(safety(cell, {{{1, 0.15, 0.06}, 0.10, "arm"}}).guards[0].enough);
}

// Openings at a height that is not stated are at any.
TEST(Safety, OpeningsAtAnyHeight) {
  Guard g;
  g.height = 2;
  g.opening = 0.030;
  Cell cell = behind(g);
  const Safety out = safety(cell, {{{1, 0.15, 1.9}, 0.10, "arm"}});
  EXPECT_FALSE(out.guards[0].enough);
  EXPECT_TRUE(std::any_of(out.assumed.begin(), out.assumed.end(),
                          [](const std::string& a) { return a.find("opening_height_mm") != std::string::npos; }));
  // A body passes, whatever is near.
  cell.guards[0].opening = 0.2;
  const Safety wide = safety(cell, {{{1, 1.9, 1}, 0.10, "arm"}});
  EXPECT_FALSE(wide.guards[0].enough);
  EXPECT_EQ(wide.guards[0].note,
            "whole bodies pass the opening of 200 mm: a smaller one is needed (ISO 13857, Table 4)");
}

// 1.6 m/s 0.3 s + 1200 mm - 0.4 * 300 mm = 1560 mm, whatever reaches over it.
TEST(Safety, AScannersDistance) {
  Guard g;
  g.kind = Guard::Kind::scanner;
  g.height = 0.3;
  g.resolution = 0.05;
  Cell cell = behind(g);
  const Safety out = safety(cell, {{{1, 1.6, 1}, 0.1, "arm"}});
  EXPECT_NEAR(out.guards.at(0).needed, 1.560, kRounding);
  EXPECT_NEAR(out.guard_distance, 1.560, kRounding);
  EXPECT_FALSE(out.guards[0].enough);
  // Too coarse for so low a field: one could crawl beneath, and the standard has no value.
  cell.guards[0].resolution = 0.08;
  cell.guards[0].measure = "a mat";
  const Safety none = safety(cell, {{{1, 1.6, 1}, 0.1, "arm"}});
  EXPECT_TRUE(std::isnan(none.guard_distance) && std::isnan(none.guard_needed)) << "not 0 mm";
  EXPECT_FALSE(none.guards[0].enough);
  EXPECT_TRUE(none.guards[0].measured);
}

// What reaches over a curtain counts: 1.6 m/s 0.3 s + 1200 mm = 1680 mm (a = 1000, b = 900), and 608 through it.
TEST(Safety, TheGuardDistanceHoldsForReachingOver) {
  Guard g;
  g.kind = Guard::Kind::curtain;
  g.height = 0.9;
  const Cell cell = behind(g);
  const Safety out = safety(cell, {{{1, 1, 1}, 0, "arm"}});
  EXPECT_NEAR(out.guard_distance, 0.608, kRounding);
  EXPECT_NEAR(out.guard_needed, 1.680, kRounding);
}

TEST(Safety, LowFencesHoldNobodyBack) {
  Guard g;
  g.height = 0.99;
  const Safety out = safety(behind(g), {{{1, 1.9, 1}, 0.1, "arm"}});
  EXPECT_FALSE(out.guards.at(0).enough);
  EXPECT_EQ(out.guards[0].note, "fences below 1 m do not hold anybody back");
}

// Where nothing is known of the machines no guard is far enough.
TEST(Safety, NothingIsJudgedWithoutPlaces) {
  Guard g;
  g.height = 2.2;
  const Safety out = safety(behind(g), {});
  EXPECT_FALSE(out.guards.at(0).enough);
  EXPECT_TRUE(out.problems.empty());
  EXPECT_NE(out.not_judged.at(0).find("no place of a machine is known"), std::string::npos);
}

}  // namespace
}  // namespace polypod::cell
