// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Corners and times against runs of LinuxCNC 2.9.0 (uspace, servo period 1 ms, 1 m/s^2, 200 mm/s), recorded at 1 kHz.
#include "polypod/machining/path_mode.hpp"

#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "examples.hpp"
#include "polypod/core/units.hpp"

namespace polypod::machining {
namespace {

using testing::unwrap;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
/// um: a record is a polygon of 1 ms steps, whose distance from the corner is known to about this.
constexpr double kRecord = 0.2;
/// Of the recorded time: lines and arcs are timed without the way that blends cut off.
constexpr double kTimeShare = 0.01;
constexpr double kShortBlockShare = 0.05;

std::vector<gcode::Move> moves_of(const std::string& text) {
  const auto run = unwrap(gcode::interpret(unwrap(gcode::parse("G21 G90 G17 G94\n" + text + "\nM2\n", "test.ngc"))));
  return {run.moves.begin(), run.moves.end()};
}

/// The joint after the second move, in um: the first goes to the start.
double deviation_um(const std::string& text) {
  return units::to_um(corners(moves_of(text)).at(1).deviation);
}

// A helix of 6 mm radius that goes over into a flat circle turns by 2 deg: the planner has 2 v^2 / a of way to blend,
// not a quarter of the circle (which gave 18.8 mm).
TEST(Corner, AHelixIntoACircleIsRoundedByNoMoreThanTheWayThatItSlowsDownOn) {
  const double um = deviation_um("G64\nG0 X6 Y0 Z0\nG3 X6 Y0 Z-1.25 I-6 J0 F800\nG3 X6 Y0 I-6 J0");
  const PlannerLimits limits;
  const double v = limits.feed_override * 800e-3 / 60;
  EXPECT_GT(um, 0);
  EXPECT_LE(um, units::to_um(2 * v * v / limits.acceleration) + 0.1);
}

TEST(Corner, LinesMeetTheRecord) {
  struct Case {
    const char* program;
    double um;
  };
  const Case cases[] = {
      {"G64\nG0 X0 Y0 Z0\nG1 X10 F1600\nY10", 375.13},
      {"G64\nG0 X0 Y0 Z0\nG1 X10 F1700\nY10", 423.41},
      {"G64 P0.05 Q0\nG0 X0 Y0 Z0\nG1 X10 F1600\nY10", 50.03},
      {"G64 P0.01 Q0\nG0 X0 Y0 Z0\nG1 X10 F1600\nY10", 10.0},
      {"G64\nG0 X0 Y0 Z0\nG1 X10 F1600\nY10 Z5", 375.13},
      {"G61\nG0 X0 Y0 Z0\nG1 X10 F1600\nY10", 0},
      {"G61.1\nG0 X0 Y0 Z0\nG1 X10 F1600\nY10", 0},
  };
  for (const Case& c : cases) EXPECT_NEAR(deviation_um(c.program), c.um, kRecord) << c.program;
  // A ramp of 5 mm in 10 after a corner, and two rapids of 10 mm (the latter at 66 mm/s: a step is 66 um long).
  EXPECT_NEAR(deviation_um("G64\nG0 X0 Y0 Z0\nG1 Y10 F1600\nX10 Z5"), deviation_um(cases[0].program), kRecord);
  EXPECT_NEAR(deviation_um("G64\nG0 X0 Y0 Z0\nG0 X10\nG0 Y10"), 2071, 1);
}

TEST(Corner, PlainModeOfLongBlocksInClosedForm) {
  // 90 deg: R = v^2 / (sqrt(3)/2 a) against 2 v^2 / (a pi/2) = 1.273 v^2 / a, the larger, times sqrt(2) - 1.
  for (const double feed : {600.0, 1600.0, 6000.0}) {
    const double v = units::from_mm_per_min(feed);
    const auto moves = moves_of("G64\nG0 X0 Y0 Z0\nG1 X500 F" + std::to_string(feed) + "\nY500");
    for (const double a : {0.5, 1.0, 3.0}) {
      PlannerLimits limits;
      limits.acceleration = a;
      EXPECT_NEAR(corners(moves, limits)[1].deviation, 4 / std::numbers::pi * (std::sqrt(2.0) - 1) * v * v / a, 1e-12);
    }
  }
}

TEST(Corner, StopsLeaveNoDeviation) {
  const char* stops[] = {
      "G64\nG0 X0 Y0 Z0\nG0 X10\nG1 Y10 F1600",               // rapid to feed
      "G64\nG0 X0 Y0 Z0\nG1 X10 F1600\nG0 Y10",               // feed to rapid
      "G64 S1000 M3\nG0 X0 Y0 Z0\nG1 X10 F1600\nS2000\nY10",  // spindle speed
      "G64\nG0 X0 Y0 Z0\nG1 X10 F1600\nM3 S100\nY10",         // spindle on
      "G61.1\nG0 X0 Y0 Z0\nG1 X10 F1600\nX20",                // exact stop, even straight on
      "G61\nG0 X0 Y0 Z0\nG1 X10 F1600\nY10",                  // exact path
      "G61\nG0 X0 Y0 Z0\nG1 X10 F1600\nG64\nY10",             // the mode of the move that ends there decides
  };
  for (const char* text : stops) {
    const Corner c = corners(moves_of(text)).at(1);
    EXPECT_EQ(c.deviation, 0) << text;
    EXPECT_EQ(c.speed, 0) << text;
  }
  EXPECT_NEAR(deviation_um("G64\nG0 X0 Y0 Z0\nG1 X10 F1600\nG61\nY10"), 375.13, kRecord);
}

TEST(Corner, TangentEndsAreRunThrough) {
  for (const char* mode : {"G61", "G64", "G64 P0.05 Q0"}) {
    const auto moves = moves_of(std::string(mode) + "\nG0 X0 Y0 Z0\nG1 X10 F1600\nX20\nG3 X30 Y10 J10\nG1 Y20");
    for (int i = 1; i < 4; ++i) {
      const Corner c = corners(moves)[static_cast<std::size_t>(i)];
      EXPECT_EQ(c.deviation, 0) << mode;
      EXPECT_NEAR(c.speed, 1.6 / 60, 1e-12) << mode;
    }
  }
}

TEST(Corner, ArcsStayBelowTheirBound) {
  struct Case {
    const char* program;
    double recorded_um;
  };
  // In a plane; then arcs of radius 5 that a line leaves by a slope of 20, 60 and 90 deg, and lines onto such arcs.
  const Case cases[] = {
      {"G64\nG0 X-8 Y0 Z0\nG1 X0 F1600\nG2 X-20 Y-20 I-20", 361.3},
      {"G64\nG0 X-8 Y0 Z0\nG1 X0 F6000\nG2 X-20 Y-20 I-20", 995.0},
      {"G64\nG0 X20 Y20 Z0\nG3 X0 Y0 J-20 F6000\nG1 X8", 508.6},
      {"G64 P0.05 Q0\nG0 X5 Y5 Z0\nG2 X0 Y0 I0 J-5 F1600\nG1 X-7.5175 Z2.7362", 72.1},
      {"G64 P0.05 Q0\nG0 X5 Y5 Z0\nG2 X0 Y0 I0 J-5 F1600\nG1 X-4 Z6.9282", 74.8},
      {"G64 P0.05 Q0\nG0 X5 Y5 Z0\nG2 X0 Y0 I0 J-5 F1600\nG1 Z8", 68.1},
      {"G64\nG0 X5 Y5 Z0\nG2 X0 Y0 I0 J-5 F1600\nG1 Z8", 683.3},
      {"G64 P0.05 Q0\nG0 X0 Y0 Z8\nG1 Z0 F1600\nG3 X5 Y5 J5", 35.6},
  };
  for (const Case& c : cases) {
    const Corner joint = corners(moves_of(c.program)).at(1);
    EXPECT_TRUE(joint.bound) << c.program;
    EXPECT_GE(units::to_um(joint.deviation), c.recorded_um) << c.program;
  }
  EXPECT_NEAR(deviation_um(cases[3].program), 100, 1e-3);  // 2 P
  EXPECT_NEAR(deviation_um(cases[7].program), 50, 1e-3);   // P
}

TEST(Corner, ParabolasWithArcsAreNotLimitedByP) {
  // Two arcs of radius 3 mm in opposite senses, 10 deg, P = 10 um; an arc of radius 1 mm into a line, P = 5 um.
  const std::string into_line = "G64 P0.005 Q0\nG0 X-0.909297 Y1.416147 Z0\nG3 X0 Y0 I0.909297 J-0.416147 ";
  EXPECT_GE(deviation_um("G64 P0.01 Q0\nG0 X-2.52441 Y1.37910 Z0\nG3 X0 Y0 I2.52441 J1.62090 F1600\n"
                         "G2 X1.759183 Y-0.221885 I0.520945 J-2.954423"),
            31.4);
  EXPECT_GE(deviation_um(into_line + "F1200\nG1 X1.999795 Y0.028621"), 41.5);
  EXPECT_GE(deviation_um(into_line + "F1200\nG1 X1.999194 Y0.056759"), 37.7);
  EXPECT_GE(deviation_um(into_line + "F2400\nG1 X1.999325 Y0.051975"), 19.3);
}

TEST(Corner, MergedLinesAddTheirTolerance) {
  // Recorded on the square under G64 P0.05, where Q = P: 91 um.
  const Corner c = corners(moves_of("G64 P0.05\nG0 X0 Y0 Z0\nG1 X10 F1600\nY10")).at(1);
  EXPECT_TRUE(c.bound);
  EXPECT_NEAR(units::to_um(c.deviation), 100, 1e-3);
  EXPECT_GT(deviation_um("G64 Q0.05\nG0 X0 Y0 Z0\nG1 X10 F1600\nY10"), 375.13 + 50);
}

TEST(Corner, OverrideAndAccelerationRoundMore) {
  const auto moves = moves_of("G64\nG0 X0 Y0 Z0\nG1 X10 F1600\nY10");
  PlannerLimits limits;
  limits.feed_override = 1.0625;  // as if the feed were 1700
  EXPECT_NEAR(units::to_um(corners(moves, limits)[1].deviation), 423.41, kRecord);
  EXPECT_NEAR(corners(moves, limits)[1].speed, 1.6 / 60, 1e-12);
  limits.velocity = 0.02;
  EXPECT_NEAR(corners(moves, limits)[1].speed, 0.02, 1e-12);
}

TEST(Corner, Properties) {
  EXPECT_TRUE(rc::check("corner of two lines", [] {
    const auto between = [](double lo, double hi) { return lo + (hi - lo) * *rc::gen::inRange(0, 1'000'001) * 1e-6; };
    gcode::Move in, out;
    in.kind = out.kind = gcode::MoveKind::line;
    in.feed = out.feed = std::pow(10, between(-3, -0.7));
    const double turn = between(0, std::numbers::pi), l1 = std::pow(10, between(-5, 0)),
                 l2 = std::pow(10, between(-5, 0));
    in.start = Vec3(-l1, 0, 0);
    out.end = l2 * Vec3(std::cos(turn), std::sin(turn), 0);
    in.path.blend_tolerance = out.path.blend_tolerance = static_cast<float>(std::pow(10, between(-6, -3)));
    PlannerLimits limits;
    limits.acceleration = std::pow(10, between(-1, 1));
    const Corner c = corner(in, out, limits);
    const double most = std::min({static_cast<double>(in.path.blend_tolerance), l1 / 4, l2 / 4});
    constexpr double kRounding = 1 + 1e-9;
    RC_ASSERT(!c.bound);
    RC_ASSERT(c.deviation >= 0);
    RC_ASSERT(c.deviation <= most * kRounding);
    RC_ASSERT(c.speed <= in.feed * kRounding);
    // The larger P, the rounder and the faster.
    in.path.blend_tolerance *= 2, out.path.blend_tolerance *= 2;
    const Corner wider = corner(in, out, limits);
    RC_ASSERT(wider.deviation * kRounding >= c.deviation);
    RC_ASSERT(wider.speed * kRounding >= c.speed);
    // The same in any direction of space.
    const Mat3 R = Eigen::AngleAxisd(between(0, 6), Vec3(1, 2, 3).normalized()).toRotationMatrix();
    in.start = R * in.start, out.end = R * out.end;
    RC_ASSERT(std::abs(corner(in, out, limits).deviation - wider.deviation) <= 1e-9);
    // Straight on: nothing.
    out.end = -in.start;
    RC_ASSERT(corner(in, out, limits).deviation == 0);
  }));
}

TEST(ProgramTime, MeetsTheRecord) {
  struct Case {
    const char* example;
    gcode::PathControl mode;
    double seconds;
  };
  using enum gcode::PathMode;
  const Case cases[] = {
      {"slavkovic_square", {exact_path, 0, 0}, 40.471},     {"slavkovic_square", {}, 40.245},
      {"slavkovic_square", {continuous, 1e-5f, 0}, 40.514}, {"slavkovic_square", {continuous, 5e-5f, 0}, 40.487},
      {"freecad_profile", {exact_path, 0, 0}, 113.583},     {"freecad_profile", {}, 113.326},
      {"freecad_profile", {continuous, 1e-5f, 0}, 113.762}, {"freecad_profile", {continuous, 5e-5f, 0}, 113.662},
      {"freecad_pocket", {exact_path, 0, 0}, 165.354},      {"freecad_pocket", {}, 150.773},
      {"freecad_pocket", {continuous, 1e-5f, 0}, 162.910},  {"freecad_pocket", {exact_stop, 0, 0}, 164.810},
  };
  for (const Case& c : cases) {
    const gcode::Program program = unwrap(gcode::read(testing::example_path(c.example, "program.ngc")));
    auto moves = unwrap(gcode::interpret(program)).moves;
    for (gcode::Move& move : moves) move.path = c.mode;
    EXPECT_NEAR(program_time(moves), c.seconds, kTimeShare * c.seconds) << c.example << " " << path_mode_words(c.mode);
  }
}

TEST(ProgramTime, OfShortBlocksWithCorners) {
  // 40 blocks of 2.5 mm, zigzag: 74 deg between neighbours.
  std::string text = "G0 X0 Y0 Z0\nG1 F1600\n";
  for (int k = 1; k <= 40; ++k) text += "X" + std::to_string(2 * k) + (k % 2 == 0 ? " Y0\n" : " Y1.5\n");
  const auto recorded = [&](const char* mode, double seconds) {
    EXPECT_NEAR(program_time(moves_of(mode + ("\n" + text))), seconds, kShortBlockShare * seconds) << mode;
  };
  recorded("G61", 4.720);
  recorded("G64", 3.439);
  recorded("G64 P0.01 Q0", 4.549);
}

TEST(ProgramTime, OfOneMoveInClosedForm) {
  // 100 mm at 10 mm/s and 1 m/s^2: s / v + v / a; 0.4 mm at 100 mm/s: never reached, 2 sqrt(s / a).
  EXPECT_NEAR(program_time(moves_of("G0 X0 Y0 Z0\nG1 X100 F600")), 10.01, 1e-9);
  EXPECT_NEAR(program_time(moves_of("G0 X0 Y0 Z0\nG1 X0.4 F6000")), 0.04, 1e-9);
  EXPECT_EQ(program_time({}), 0);
  EXPECT_NEAR(shortest_block(units::from_mm_per_min(1600)), 53.333e-6, 1e-9);
}

TEST(ChoosePathMode, TakesTheSmallestSlackOfACorner) {
  const auto moves = moves_of("G0 X0 Y0 Z0\nG1 X50 F1600\nX100\nY100\nX0\nG0 Z10");
  // Joints after moves 1 (straight on), 2 and 3 (corners), 4 (to the rapid).
  const PathModeChoice choice = choose_path_mode(moves, std::vector<double>{kInfinity, 0, 45.37e-6, 60e-6, 0, 0});
  EXPECT_EQ(path_mode_words(choice.control), "G64 P0.0453 Q0");
  EXPECT_EQ(choice.limiting, 2);
  EXPECT_GT(choice.time_after, choice.time_before);  // plain G64 before
  EXPECT_LT(choice.time_after, choice.time_before * 1.02);
  auto chosen = moves;
  for (gcode::Move& move : chosen) move.path = choice.control;
  EXPECT_LE(corners(chosen)[2].deviation, 45.37e-6);
  EXPECT_LE(corners(chosen)[3].deviation, 60e-6);

  const PathModeChoice stop = choose_path_mode(moves, std::vector<double>{0, 0, 0.9e-6, 1, 0});
  EXPECT_EQ(path_mode_words(stop.control), "G61.1");
  EXPECT_GT(stop.time_after, choice.time_after);
  const PathModeChoice free = choose_path_mode(moves, std::vector<double>(5, kInfinity));
  EXPECT_EQ(path_mode_words(free.control), "G64");
  EXPECT_EQ(free.limiting, -1);
}

/// What the program allows at its corners is never widened: found where a correction of G64 P0.02 came out as G64.
TEST(ChoosePathMode, NeverWidensTheProgramsOwnTolerance) {
  const auto moves = moves_of("G64 P0.02\nG0 X0 Y0 Z0\nG1 X50 F1600\nX100\nG64 P0.1\nY100\nX0");
  const auto written = [&](double slack) {
    return path_mode_words(choose_path_mode(moves, std::vector<double>(5, slack)).control);
  };
  EXPECT_EQ(written(kInfinity), "G64 P0.02 Q0");
  EXPECT_EQ(written(45e-6), "G64 P0.02 Q0");
  EXPECT_EQ(written(15e-6), "G64 P0.015 Q0");
  const auto plain = moves_of("G61\nG0 X0 Y0 Z0\nG1 X50 F1600\nG64\nX100\nY100");
  EXPECT_EQ(path_mode_words(choose_path_mode(plain, std::vector<double>(5, kInfinity)).control), "G64");
}

TEST(ChoosePathMode, HalfWhereALineLeavesThePlaneOfAnArc) {
  const auto moves = moves_of("G0 X5 Y5 Z0\nG2 X0 Y0 I0 J-5 F1600\nG1 Z8");
  EXPECT_EQ(path_mode_words(choose_path_mode(moves, std::vector<double>{1, 45e-6, 1}).control), "G64 P0.0225 Q0");
}

TEST(ChoosePathMode, NamesEachArcThatOnlyAStopKeeps) {
  // Two kinks of 11 deg between arcs of 2 mm, and a corner of lines which P keeps.
  const auto moves =
      moves_of("G0 X0 Y0 Z0\nG1 X10 F1600\nG1 Y20\nG2 X12 Y22 I2 J0\nG2 X14.3884 Y20.04 I0.39 J-1.96\nG1 Y0\nG1 X30");
  const PathModeChoice choice = choose_path_mode(moves, std::vector<double>(moves.size(), 30e-6));
  EXPECT_EQ(path_mode_words(choice.control), "G61.1");
  auto kept = moves;
  for (gcode::Move& move : kept) move.path = {gcode::PathMode::continuous, 30e-6f, 0};
  std::vector<int> expected;
  const auto joints = corners(kept);
  for (std::size_t i = 0; i < joints.size(); ++i)
    if (joints[i].deviation > 31e-6) expected.push_back(static_cast<int>(i));
  EXPECT_FALSE(expected.empty());
  EXPECT_EQ(choice.not_kept, expected);
  EXPECT_EQ(choice.limiting, expected.front());
}

// Q merges lines only: a contour of arcs takes as long with it as without, and as its length at the feed.
TEST(ProgramTime, OfArcsUnderGSixtyFourWithP) {
  const std::string circle = "\nG0 X-50 Y0 Z0\nG3 X-50 Y36 J18 F800\nG3 X-50 Y0 J-18",
                    corner = "\nG0 X-50 Y0 Z0\nG1 X-20 F800\nG3 X-10 Y10 J10\nG1 Y40";
  for (const auto& [path, length] : {std::pair{circle, 2 * M_PI * 18}, {corner, 60 + M_PI * 5}}) {
    const double at_feed = length / 800 * 60;
    const double merging = program_time(moves_of("G64 P0.05" + path)),
                 not_merging = program_time(moves_of("G64 P0.05 Q0" + path));
    EXPECT_NEAR(merging, not_merging, 1e-3 * not_merging);
    EXPECT_GT(merging, at_feed);
    EXPECT_LT(merging, 1.2 * at_feed) << path;  // with the rapid before
  }
}

TEST(PathModeWords, InBothUnits) {
  EXPECT_EQ(path_mode_words({gcode::PathMode::exact_path, 0, 0}), "G61");
  EXPECT_EQ(path_mode_words({gcode::PathMode::continuous, 5e-5f, 1e-5f}), "G64 P0.05 Q0.01");
  EXPECT_EQ(path_mode_words({gcode::PathMode::continuous, 5e-5f, 0}, true), "G64 P0.00196 Q0");
  // What is written is read back.
  const auto moves = moves_of("G64 P0.0453 Q0\nG0 X0 Y0 Z0");
  EXPECT_EQ(path_mode_words(moves[0].path), "G64 P0.0453 Q0");
}

}  // namespace
}  // namespace polypod::machining
