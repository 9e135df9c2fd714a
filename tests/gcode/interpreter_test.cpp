// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What programs do: modal state, units, planes, arcs, and what is refused.
#include "polypod/gcode/interpreter.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "polypod/gcode/unroll.hpp"

namespace polypod::gcode {
namespace {

constexpr double kPi = std::numbers::pi;
/// Numbers below 1 m carry a rounding error of about 1e-16 m an operation; 1e-12 m leaves four orders of room.
constexpr double kExact = 1e-12;

Result<Interpretation> run(const std::string& text, const InterpretOptions& options = {}) {
  auto program = parse(text, "part.ngc");
  if (!program) return tl::unexpected(program.error());
  return interpret(*program, options);
}

Interpretation good(const std::string& text, const InterpretOptions& options = {}) {
  auto result = run(text, options);
  EXPECT_TRUE(result.has_value()) << text << "\n" << (result ? "" : to_string(result.error()));
  return result ? std::move(*result) : Interpretation{};
}

void expect_near(const Vec3& a, const Vec3& b, double tolerance = kExact) {
  EXPECT_LE((a - b).norm(), tolerance) << a.transpose() << " against " << b.transpose();
}

Vec3 mm(double x, double y, double z) {
  return Vec3(x, y, z) / 1000;
}

TEST(Interpret, LinesInBothUnitsAndDistanceModes) {
  const auto r = good("G21 G90\nG0 X10 Y20 Z30\nG1 X11 F600\nG91 Y1\nG20 Z1\nG90 X0\nM2\n");
  ASSERT_EQ(r.moves.size(), 5u);
  EXPECT_EQ(r.moves[0].kind, MoveKind::rapid);
  EXPECT_FALSE(r.moves[0].start_known);
  EXPECT_TRUE(r.moves[1].start_known);
  expect_near(r.moves[0].end, mm(10, 20, 30));
  expect_near(r.moves[1].end, mm(11, 20, 30));
  expect_near(r.moves[2].end, mm(11, 21, 30));
  expect_near(r.moves[3].end, mm(11, 21, 55.4));
  expect_near(r.moves[4].end, mm(0, 21, 55.4));
  EXPECT_NEAR(r.moves[1].feed, 0.01, kExact);
  EXPECT_NEAR(r.moves[4].feed, 0.01, kExact);
  EXPECT_TRUE(r.ended);
  EXPECT_TRUE(r.moves[3].inches);
  EXPECT_TRUE(r.moves[3].incremental);
}

TEST(Interpret, PathControlModes) {
  const auto r = good(
      "G21 G90 G94\nG0 X0 Y0 Z0\nG61\nG1 X1 F600\nG61.1 X2\nG64\nX3\nG64 P0.05\nX4\nG64 P0.05 Q0\nX5\nG64 Q0.01\nX6\n"
      "G20 G64 P0.001 Q0.002\nX7\nM2\n");
  const PathControl expected[] = {{PathMode::continuous, 0, 0},         {PathMode::exact_path, 0, 0},
                                  {PathMode::exact_stop, 0, 0},         {PathMode::continuous, 0, 0},
                                  {PathMode::continuous, 5e-5f, 5e-5f}, {PathMode::continuous, 5e-5f, 0},
                                  {PathMode::continuous, 0, 1e-5f},     {PathMode::continuous, 2.54e-5f, 5.08e-5f}};
  ASSERT_EQ(r.moves.size(), std::size(expected));
  for (std::size_t i = 0; i < r.moves.size(); ++i) EXPECT_EQ(r.moves[i].path, expected[i]) << i;
}

struct ArcCase {
  const char* text;
  Vec3 centre;
  double sweep;
  Vec3 middle;
};

// Recorded on LinuxCNC's planner in the middle of a straight line at its feed (docs/path-modes.md).
TEST(Interpret, WordsForWhichTheControllerStops) {
  const auto stops = [](const std::string& between) {
    const auto r = good("G21 G90 S8000 M3\nT1 M6\nG0 X0 Y0 Z0\nG1 X1 F600\n" + between + "\nG1 X2\nG1 X3\nM2\n");
    EXPECT_FALSE(r.moves.back().stops_before) << between;
    return r.moves[r.moves.size() - 2].stops_before;
  };
  for (const char* word :
       {"M3",           "S8000",        "S9000",  "M9",        "M8",        "M7",          "G4 P0",
        "(MSG, hello)", "( msg,hello)", "M64 P0", "M68 E0 Q1", "M66 P0 L0", "G43 H1",      "M5",
        "M0",           "M1",           "M60",    "M6",        "M100",      "G1 X1 S8000", "G1 X1.5 M0"}) {
    EXPECT_TRUE(stops(word)) << word;
  }
  for (const char* word : {"M62 P0", "M67 E0 Q1", "T1", "G54", "F700", "M48", "M50", "G91\nG90", "G17", "G61", "G64",
                           "(hello)", "; MSG, hello", ""}) {
    EXPECT_FALSE(stops(word)) << word;
  }
  // Before the motion of its own block; a way of no length hands it on.
  EXPECT_TRUE(good("G0 X0 Y0 Z0\nG1 X1 F600\nX2 M8\nM2\n").moves.back().stops_before);
  EXPECT_FALSE(good("G0 X0 Y0 Z0\nG1 X1 F600\nX2 M0\nM2\n").moves.back().stops_before);
  EXPECT_TRUE(good("G0 X0 Y0 Z0\nG1 X1 F600\nM8\nX1\nX2\nM2\n").moves.back().stops_before);
}

TEST(Interpret, ArcsOfEveryKind) {
  const double h = 10 * std::sqrt(0.5);
  const std::vector<ArcCase> cases{
      {"G0 X10 Y0 Z0\nG3 X0 Y10 I-10 J0 F60\nM2\n", mm(0, 0, 0), kPi / 2, mm(h, h, 0)},
      {"G0 X10 Y0 Z0\nG2 X0 Y10 I-10 F60\nM2\n", mm(0, 0, 0), 3 * kPi / 2, mm(-h, -h, 0)},
      {"G0 X10 Y0 Z0\nG3 X0 Y10 R10 F60\nM2\n", mm(0, 0, 0), kPi / 2, mm(h, h, 0)},
      {"G0 X10 Y0 Z0\nG3 X0 Y10 R-10 F60\nM2\n", mm(10, 10, 0), 3 * kPi / 2, mm(10 + h, 10 + h, 0)},
      {"G0 X10 Y0 Z0\nG2 X0 Y10 R10 F60\nM2\n", mm(10, 10, 0), kPi / 2, mm(10 - h, 10 - h, 0)},
      {"G0 X10 Y0 Z0\nG3 I-10 F60\nM2\n", mm(0, 0, 0), 2 * kPi, mm(-10, 0, 0)},
      {"G0 X10 Y0 Z0\nG2 I-10 Z4 P3 F60\nM2\n", mm(0, 0, 0), 6 * kPi, mm(-10, 0, 2)},
      {"G90.1\nG0 X10 Y5 Z0\nG3 X0 Y15 I0 J5 F60\nM2\n", mm(0, 5, 0), kPi / 2, mm(h, 5 + h, 0)},
      // G18: seen from +Y, counterclockwise runs from Z to X.
      {"G18\nG0 X0 Y0 Z10\nG3 X10 Z0 K-10 F60\nM2\n", mm(0, 0, 0), kPi / 2, mm(h, 0, h)},
      {"G18\nG0 X10 Y0 Z0\nG2 X0 Z10 I-10 F60\nM2\n", mm(0, 0, 0), kPi / 2, mm(h, 0, h)},
      {"G18\nG0 X0 Y0 Z10\nG3 X10 Z0 R10 F60\nM2\n", mm(0, 0, 0), kPi / 2, mm(h, 0, h)},
      // G19: seen from +X, counterclockwise runs from Y to Z.
      {"G19\nG0 X0 Y10 Z0\nG3 X6 Y0 Z10 J-10 F60\nM2\n", mm(0, 0, 0), kPi / 2, mm(3, h, h)},
      {"G91\nG0 X10 Y0 Z0\nG3 X-10 Y10 I-10 F60\nM2\n", mm(0, 0, 0), kPi / 2, mm(h, h, 0)},
  };
  for (const ArcCase& c : cases) {
    SCOPED_TRACE(c.text);
    const auto r = good(c.text);
    ASSERT_EQ(r.moves.size(), 2u);
    const Move& arc = r.moves[1];
    EXPECT_EQ(arc.kind, MoveKind::arc);
    expect_near(arc.centre, c.centre);
    EXPECT_NEAR(arc.sweep, c.sweep, kExact);
    expect_near(arc.point(arc.length() / 2), c.middle);
    expect_near(arc.point(0), arc.start);
    expect_near(arc.point(arc.length()), arc.end);
  }
}

TEST(Interpret, RefusesWithPlaceAndId) {
  struct Bad {
    std::string text, id;
    int line, column;
  };
  const std::vector<Bad> cases{
      {"G1 X1 F10\nG2 X5 Y5\nM2\n", "GC104", 2, 1},
      {"G0 X1 X2\n", "GC108", 1, 7},
      {"G0 G1 X2 F1\n", "GC109", 1, 4},
      {"G90 G91 X2\n", "GC109", 1, 5},
      {"M3 M5\n", "GC109", 1, 4},
      {"X1\n", "GC110", 1, 1},
      {"G0 X1\nG80 X1\n", "GC110", 2, 5},
      {"G1 X1\n", "GC111", 1, 1},
      {"G1 X1 F0\n", "GC111", 1, 7},
      {"G1 F5 X1\nN5 G94\nN6 X2\n", "GC111", 3, 4},
      {"G1 X1 F-1\n", "GC111", 1, 7},
      {"G93 G1 X1 F1\nX2\n", "GC112", 2, 1},
      {"F100 G1 X1\nG93\nG94 X3\n", "GC111", 3, 5},
      {"F100\nG2 X10 R4.99\n", "GC113", 2, 8},
      {"F100\nG2 X10 I6\n", "GC114", 2, 1},
      {"F100\nG2 X10 I0\n", "GC115", 2, 1},
      {"F100\nG2 X10 I5 K1\n", "GC116", 2, 11},
      {"F100\nG2 X10 I5 R5\n", "GC116", 2, 11},
      {"F100\nG90.1 G2 X10 I5\n", "GC117", 2, 7},
      {"F100\nG2 X10 I5 P1.5\n", "GC118", 2, 11},
      {"F100\nG2 X10 I5 P0\n", "GC118", 2, 11},
      {"F100\nG2 R5\n", "GC136", 2, 4},
      {"G1 X1 I2 F1\n", "GC119", 1, 7},
      {"G0 X1 H2\n", "GC119", 1, 7},
      {"G0 X1 E2\n", "GC119", 1, 7},
      {"F1\nG64 G2 I5 P1\n", "GC119", 2, 11},
      {"F1\nG4 G2 I5 P1\n", "GC119", 2, 10},
      {"G123 X1\n", "GC120", 1, 1},
      {"G1.5 X1\n", "GC120", 1, 1},
      {"M428\n", "GC120", 1, 1},
      {"G21 M10\n", "GC178", 1, 5},
      {"M200\n", "GC178", 1, 1},
      {"M97\n", "GC123", 1, 1},
      {"G1.55 X1\n", "GC132", 1, 1},
      {"G41 D1\n", "GC121", 1, 1},
      {"G42.1 D5\n", "GC121", 1, 1},
      {"G81 X1 R1 Z-1 F1\n", "GC122", 1, 1},
      {"G73 X1 R1 Z-1 F1\n", "GC122", 1, 1},
      {"o100 sub\n", "GC123", 1, 1},
      {"M98 P100\n", "GC123", 1, 1},
      {"G65 P100\n", "GC123", 1, 1},
      {"G0 X#1\n", "GC124", 1, 5},
      {"G0 X[1+1]\n", "GC124", 1, 5},
      {"#1 = 5\n", "GC124", 1, 1},
      {"G10 L2 P1 X0\n", "GC125", 1, 1},
      {"G92 X0\n", "GC125", 1, 1},
      {"G52 X1\n", "GC125", 1, 1},
      {"G68 R30\n", "GC125", 1, 1},
      {"G51 X0 P2\n", "GC125", 1, 1},
      {"G16\n", "GC125", 1, 1},
      {"G59.1\n", "GC125", 1, 1},
      {"G0 @5 ^30\n", "GC125", 1, 4},
      {"G28 X5\n", "GC126", 1, 1},
      {"G91 G30 Z1\n", "GC126", 1, 5},
      {"G53 Z0\n", "GC168", 1, 1},
      {"G5 X1 Y1 I0 J1 P0 Q1\n", "GC127", 1, 1},
      {"G5.2 X1 P1\n", "GC127", 1, 1},
      {"G33 Z-1 K1\n", "GC128", 1, 1},
      {"G38.2 Z-1 F1\n", "GC128", 1, 1},
      {"G76 P1 Z-1\n", "GC128", 1, 1},
      {"G95\n", "GC129", 1, 1},
      {"G96 S100\n", "GC129", 1, 1},
      {"G7\n", "GC130", 1, 1},
      {"G0 U1\n", "GC130", 1, 4},
      {"G21\nF10\nG20 G1 X1 F1\n", "GC131", 3, 11},
      {"S-1\n", "GC132", 1, 1},
      {"T1.5\n", "GC132", 1, 1},
      {"M3.3\n", "GC132", 1, 1},
      {"G43 H-1\n", "GC132", 1, 5},
      {"%\nG0 X1\n", "GC133", 2, 1},
      {"G4 X1\n", "GC134", 1, 1},
      {"G4\n", "GC134", 1, 1},
      {"G4 P-1\n", "GC134", 1, 4},
      {"G0 X100000001\n", "GC135", 1, 4},
      {"M61\n", "GC132", 1, 1},
  };
  for (const Bad& bad : cases) {
    const auto result = run(bad.text);
    ASSERT_FALSE(result.has_value()) << bad.text;
    EXPECT_EQ(result.error().id, bad.id) << bad.text << to_string(result.error());
    EXPECT_EQ(result.error().place.line, bad.line) << bad.text;
    EXPECT_EQ(result.error().place.column, bad.column) << bad.text;
    EXPECT_FALSE(result.error().hint.empty()) << bad.text;
  }
}

/// Brute force: the closest of many points on the move.
double sampled_distance(const Move& move, const Vec3& p, int samples) {
  double best = 1e300;
  for (int i = 0; i <= samples; ++i) best = std::min(best, (p - move.point(move.length() * i / samples)).norm());
  return best;
}

TEST(Move, NearestIsNeverBeatenBySamples) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (int trial = 0; trial < 600; ++trial) {
    Move move;
    move.kind = trial % 5 == 0 ? MoveKind::line : MoveKind::arc;
    move.plane = static_cast<Plane>(trial % 3);
    const int n = trial % 3 == 0 ? 2 : trial % 3 == 1 ? 1 : 0;  // the normal axis
    const int a = (n + 1) % 3;
    const int b = (n + 2) % 3;
    move.clockwise = trial % 2 == 0;
    move.sweep = kPi * (1.001 + uniform(random)) * (trial % 7 == 0 ? 5 : 1);
    const double radius = 0.02 + 0.015 * uniform(random);
    const double rise = trial % 4 == 0 ? 0.0 : 0.2 * uniform(random);
    const double from = kPi * uniform(random);
    const double to = from + (move.clockwise ? -1 : 1) * move.sweep;
    move.centre = 0.05 * Vec3(uniform(random), uniform(random), uniform(random));
    move.start = move.end = move.centre;
    move.start[a] += radius * std::cos(from);
    move.start[b] += radius * std::sin(from);
    move.end[a] += radius * std::cos(to);
    move.end[b] += radius * std::sin(to);
    move.end[n] += rise;
    const Vec3 p = move.centre + 0.06 * Vec3(uniform(random), uniform(random), uniform(random));
    const double s = move.nearest(p);
    ASSERT_GE(s, 0);
    ASSERT_LE(s, move.length());
    EXPECT_LE((p - move.point(s)).norm(), sampled_distance(move, p, 2000) + kExact) << trial;
    if (s > 1e-9 && s < move.length() - 1e-9) {
      // There the connecting line is normal to the path; 1e-7 because the derivative vanishes quadratically.
      EXPECT_NEAR((p - move.point(s)).dot(move.direction(s)), 0, 1e-9) << trial;
    }
  }
}

TEST(Move, DirectionIsTheDerivativeOfPoint) {
  const auto r = good("G0 X10 Y0 Z0\nG2 X0 Y10 Z7 I-10 F60\nG18 G3 X12 Z20 R40\nM2\n");
  for (const Move& move : r.moves) {
    for (const double f : {0.1, 0.5, 0.9}) {
      const double s = f * move.length();
      const double step = 1e-7;
      const Vec3 difference = (move.point(s + step) - move.point(s - step)) / (2 * step);
      // Central differences of step 1e-7 m round off at about 1e-16 / 1e-7.
      expect_near(move.direction(s), difference, 1e-7);
    }
  }
}

TEST(Interpret, PlacesOfTheMachineAreNotKnown) {
  for (const std::string word : {"G28", "G91 G28 Z0\nG90", "G53 G0 Z0", "G91 G30 X0 Y0 Z0\nG90"}) {
    const auto result = run("G0 X1 Y2 Z3\n" + word + "\nG0 Z5\nG0 X1 Y2\nM2\n");
    ASSERT_TRUE(result.has_value()) << word << to_string(result.error());
    ASSERT_EQ(result->moves.size(), 3u) << word;
    EXPECT_FALSE(result->moves[1].start_known) << word;
    EXPECT_FALSE(result->moves[1].known_start[2]) << word;
    EXPECT_TRUE(result->moves[2].known_end[0]) << word;
    ASSERT_FALSE(result->notes.empty());
    EXPECT_TRUE(std::any_of(result->notes.begin(), result->notes.end(), [](const std::string& note) {
      return note.find("a place of the machine") != std::string::npos;
    })) << word;
  }
}

TEST(Interpret, LinesThatLinuxCncDoesNotReadAreRefused) {
  const auto program = [](std::size_t length) {
    return *parse("G0 X1 (" + std::string(length - 8, 'a') + ")\nM2\n", "long.ngc");
  };
  EXPECT_TRUE(interpret(program(252)));
  const auto longer = interpret(program(253));
  ASSERT_FALSE(longer);
  EXPECT_EQ(longer.error().id, "GC108");
  EXPECT_EQ(longer.error().place.line, 1);
}

// rs274: STOP_SPINDLE_TURNING, CHANGE_TOOL. A start in the same block comes after the change.
TEST(Interpret, AToolChangeStopsTheSpindle) {
  const auto spindles = [](const std::string& text) {
    const Program program = *parse(text, "change.ngc");
    std::vector<Spindle> out;
    const Interpretation run = *interpret(program);
    for (const Move& move : run.moves) out.push_back(move.spindle);
    return out;
  };
  EXPECT_EQ(spindles("S6000 M3\nG0 X0 Y0 Z0\nT2 M6\nG0 X1\nM3\nG0 X2\n"),
            (std::vector{Spindle::clockwise, Spindle::off, Spindle::clockwise}));
  EXPECT_EQ(spindles("S6000 T2 M3 M6\nG0 X1\n"), std::vector{Spindle::clockwise});
}

TEST(Interpret, KnowsWhatPassesThrough) {
  const Program program = *parse(
      "O1000 (PART)\nG17 G40 G49 G80 G94\nT3 M6\nG43 H3\nS6000 M3 M8\nG61\nG4 P1.5\nG0 Z5\nG1 Z1 "
      "F100\nM5\nM30\nrubbish $$\n",
      "part.ngc");
  const Interpretation r = *interpret(program);
  EXPECT_EQ(r.moves[0].tool, 3);
  EXPECT_EQ(r.moves[0].spindle, Spindle::clockwise);
  EXPECT_NEAR(r.moves[0].spindle_speed, 100, kExact);
  std::string all;
  for (const auto& p : r.passed_through) all += std::string(p.what(program)) + "|";
  EXPECT_EQ(all, "(PART)|O1000|G40|G49|G80|M6|G43|M3|M8|G61|G4|M5|M30|");
  EXPECT_EQ(r.states.size(), 12u);
  EXPECT_FALSE(r.states[11].executed);
  EXPECT_EQ(r.states[8].motion, 1);
}

TEST(Interpret, WorkOffsets) {
  InterpretOptions options;
  options.work_offsets[1] = mm(100, 0, 5);
  const auto r = good("G54 G0 X1 Y2 Z3\nG55 X1\nG1 Z0 F10\nG91 X1\nG54 G90 X0\nM2\n", options);
  ASSERT_EQ(r.moves.size(), 5u);
  expect_near(r.moves[1].end, mm(101, 2, 3));
  expect_near(r.moves[2].end, mm(101, 2, 5));
  expect_near(r.moves[3].end, mm(102, 2, 5));
  expect_near(r.moves[4].end, mm(0, 2, 5));
  EXPECT_EQ(r.moves[1].work_offset, 1);
}

TEST(Interpret, BlockDelete) {
  InterpretOptions options;
  EXPECT_EQ(good("G0 X1\n/X2\nM2\n", options).moves.size(), 2u);
  options.block_delete = true;
  EXPECT_EQ(good("G0 X1\n/X2\nM2\n", options).moves.size(), 1u);
}

TEST(Interpret, EndOfProgram) {
  EXPECT_TRUE(good("%\nG0 X1\n%\n").ended);
  EXPECT_TRUE(good("%\nG0 X1\nM30\n").ended);
  const auto open = good("G0 X1\n");
  EXPECT_FALSE(open.ended);
  EXPECT_NE(open.notes.back().find("cut off"), std::string::npos);
}

TEST(Interpret, RotaryAxes) {
  const auto r = good("G0 X0 A10 B-20\nG91 G1 A10 C5 F60\nG20 A10\nG90 B90\nM2\n");
  const double deg = kPi / 180;
  expect_near(r.moves[0].axes_end, deg * Vec3(10, -20, 0));
  expect_near(r.moves[1].axes_end, deg * Vec3(20, -20, 5));
  expect_near(r.moves[2].axes_end, deg * Vec3(30, -20, 5));
  expect_near(r.moves[3].axes_end, deg * Vec3(30, 90, 5));
  expect_near(r.moves[3].axes_start, r.moves[2].axes_end);
  EXPECT_EQ(r.moves[1].length(), 0);
}

TEST(Interpret, FeedInInches) {
  const auto r = good("G20\nF60\nG1 X1\nG21\nX0\nF60\nX1\nM2\n");
  EXPECT_NEAR(r.moves[0].feed, 0.0254, kExact);
  EXPECT_NEAR(r.moves[1].feed, 0.0254, kExact);  // the speed stays, whatever the unit
  EXPECT_NEAR(r.moves[2].feed, 0.001, kExact);
  // In the block that sets the first unit, F is in that unit, and a note says so.
  const auto first = good("G20 G1 X1 F60\nM2\n");
  EXPECT_NEAR(first.moves[0].feed, 0.0254, kExact);
  EXPECT_NE(first.notes.front().find("inches"), std::string::npos);
}

TEST(Interpret, WhatIsKnownOfTheStart) {
  const auto known = [](const std::string& text) {
    std::string pattern;
    for (const Move& move : good(text + "M2\n").moves) pattern += move.start_known ? '1' : '0';
    return pattern;
  };
  EXPECT_EQ(known("G0 X1 Y1\nX2\nZ3\nX4\n"), "0001");
  EXPECT_EQ(known("G91\nG0 X1 Y1 Z1\nX1\n"), "00");
  // A new tool length moves the tip in Z, until Z is commanded; the same one again does not, nor does G49 without one.
  EXPECT_EQ(known("G49\nG0 X1 Y1 Z1\nG49\nX2\nG43 H1\nX3\nZ1\nX4\nG43 H1\nX5\nG43 H2\nX6\nZ1\nX7\n"), "010011001");
  EXPECT_EQ(known("G0 X1 Y1 Z1\nG43.1 X5\nX2\nY2\nZ2\nX3\n"), "00001");
}

TEST(Interpret, InverseTimeFeed) {
  const auto r = good("G93\nG1 X60 F2\nG3 I-60 F1\nG0 X0\nM2\n");
  EXPECT_NEAR(r.moves[0].feed, 0.06 * 2 / 60, kExact);
  EXPECT_NEAR(r.moves[1].feed, 0.12 * kPi / 60, kExact);
  EXPECT_EQ(r.moves[0].feed_mode, FeedMode::inverse);
}

TEST(Dwells, AreCountedToTheEndOfTheProgram) {
  EXPECT_EQ(dwell_time(*parse("G0 X1\nG4 P2.5\nG1 X2 F100\nG4 P0.5\nM2\nG4 P7\n", "part.ngc"), false), 3.0);
  EXPECT_EQ(dwell_time(*parse("G0 X1\nM66 P0 L3 Q5\nM2\n", "part.ngc"), false), 0.0);
  for (const bool block_delete : {false, true}) {
    EXPECT_EQ(dwell_time(*parse("G4 P1\n/G4 P2\nG0 X1\nM2\n", "part.ngc"), block_delete), block_delete ? 1.0 : 3.0);
  }
}

}  // namespace
}  // namespace polypod::gcode
