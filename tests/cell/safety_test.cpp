// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Distances of guards against the formulas of the standards, worked by hand in mm.
#include "polypod/cell/safety.hpp"

#include <gtest/gtest.h>

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

TEST(Safety, ACurtainTooNearIsAProblemUnlessAMeasureIsStated) {
  Cell cell;
  Machine m;
  m.name = "arm";
  m.stopping = 0.3;
  cell.machines.push_back(m);
  Guard g;
  g.name = "front";
  g.kind = Guard::Kind::curtain;
  g.from = {0, 0, 0};
  g.to = {2, 0, 0};
  g.height = 1.8;
  cell.guards.push_back(g);
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

// ISO 13855: T is the response of the device, of the control and the stopping time together. 1.6 m/s (0.3 + 0.02 +
// 0.05) s
// + 8 (30 - 14) mm = 720 mm.
TEST(Safety, TimesOfDeviceAndControlCount) {
  Cell cell;
  Machine m;
  m.name = "arm";
  m.stopping = 0.3;
  cell.machines.push_back(m);
  Guard g;
  g.name = "front";
  g.kind = Guard::Kind::curtain;
  g.to = {2, 0, 0};
  g.response = 0.02;
  cell.guards.push_back(g);
  cell.control_response = 0.05;
  const Safety out = safety(cell, {{{1, 1, 1}, 0.1, "arm"}});
  EXPECT_NEAR(out.guards.at(0).stopping, 0.37, kRounding);
  EXPECT_NEAR(out.guards.at(0).needed, 0.720, kRounding);
}

// A fence of 2 m with round openings of 30 mm: 120 mm (ISO 13857, Table 4) from the surface of what is moved.
TEST(Safety, OpeningsCountFromTheSurfaceOfWhatIsMoved) {
  Cell cell;
  Machine m;
  m.name = "arm";
  m.stopping = 0.3;
  cell.machines.push_back(m);
  Guard g;
  g.name = "fence";
  g.to = {2, 0, 0};
  g.height = 2;
  g.opening = 0.030;
  g.opening_height = 1;
  cell.guards.push_back(g);
  EXPECT_TRUE(safety(cell, {{{1, 0.15, 1}, 0.01, "arm"}}).problems.empty());
  const Safety near = safety(cell, {{{1, 0.15, 1}, 0.10, "arm"}});
  ASSERT_EQ(near.guards.size(), 1U);
  EXPECT_FALSE(near.guards[0].enough);
  EXPECT_NE(near.guards[0].note.find("50 mm away, 120 mm is needed"), std::string::npos) << near.guards[0].note;
  // Out of an arm's reach up or down through the opening.
  EXPECT_TRUE(safety(cell, {{{1, 0.15, 0.1}, 0.10, "arm"}}).guards[0].enough);
}

}  // namespace
}  // namespace polypod::cell
