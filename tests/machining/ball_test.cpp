// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Balls and bull noses in predict and correct.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "machining/examples.hpp"
#include "polypod/core/units.hpp"
#include "polypod/cutting/rounded.hpp"
#include "polypod/machining/tilted.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod {
namespace {

using ::testing::Contains;
using testing::Example;
using ::testing::HasSubstr;
using testing::with_program;

Example groove(const std::string& program) {
  Example e = with_program("slavkovic_groove", program);
  e.job.cutter.corner_radius = e.job.cutter.radius();
  return e;
}

// A groove: the closed form of a ball in a slot, and the compliance of the machine.
TEST(Ball, AGrooveIsTheClosedForm) {
  const Example e = groove("G21 G90 S12000 M3\nG0 X-45 Y0 Z10\nG0 Z-1.5\nG1 X45 F1800\nG0 Z10\nM2\n");
  machining::PredictOptions options;
  options.bend = machining::Bend::at_rest;
  options.keep_samples = true;
  const machining::Prediction p = testing::predict(e, options);
  const Vec3 force = cutting::mean_force(
      e.job.cutter, e.job.material, cutting::straight_slices(e.job.cutter, cutting::CutSide::slot, 0, 1.5e-3), 0.05e-3);
  int compared = 0;
  for (const machining::Sample& s : p.samples) {
    if (!s.cutting || std::abs(s.command.x()) > 20e-3) continue;
    EXPECT_LT((s.force - force).norm(), 0.02 * force.norm());
    const auto c = statics::compliance_at(e.job.machine, Pose{Mat3::Identity(), e.job.X_MW * s.command});
    EXPECT_LT((s.deflection - c.displacement(s.force)).norm(), 1e-9);
    ++compared;
  }
  EXPECT_GT(compared, 60);
  EXPECT_THAT(p.notes, Contains(HasSubstr("a ball cuts")));
}

/// Machine and block of `groove`, turned by 90 deg about x of W, for a program that is.
void lay_down(Example& e) {
  const Mat3 Q = rotation_x(units::from_deg(90));
  e.job.stock = testing::unwrap(cutting::Stock::block({-30e-3, 0, -20e-3}, {30e-3, 20e-3, 20e-3}, e.job.stock.cell()));
  auto arm = std::get<machine::SerialArm>(e.job.machine);
  const Vec3 o = e.job.X_MW.p;
  arm.X_MB = Pose{Q, o - Q * o} * arm.X_MB;
  e.job.machine = machine::AnyMachine(arm);
}

/// The corrected program in the stock's cells and in cells half as large, by passes of its own.
void expect_in_tube_at_both_cells(Example e, const machining::Correction& c) {
  testing::expect_in_tube(e, c);
  e.job.stock = e.job.stock.in_half_cells();
  testing::expect_in_tube(e, c);
}

/// No move that was inside the tube has left it, and none that is outside has come farther.
void expect_never_worse(const Example& e, const machining::Correction& c) {
  constexpr double kSame = 1e-6;
  for (const machining::MoveOutcome& m : c.moves) {
    EXPECT_LE(m.distance_after, std::max(m.distance_before + kSame, e.job.tolerance)) << "line " << m.line;
  }
  EXPECT_LE(c.largest_distance, c.before.largest_distance + kSame);
}

constexpr const char* kSlope =
    "G21 G90 S12000 M3\nG0 X-45 Y0 Z10\nG0 Z-0.3\nG1 X-20 F1200\nG1 X-15 Z-2.1199\nG1 X-10 Z-0.3\nG1 X0\n"
    "G1 X5 Z-2.1199\nG1 X12\nG1 X17 Z-0.3\nG1 X45\nG0 Z10\nM2\n";

TEST(Ball, AGrooveIsCorrected) {
  const Example e = groove("G21 G90 S12000 M3\nG0 X-45 Y0 Z10\nG0 Z-1.5\nG1 X45 F1800\nG0 Z10\nM2\n");
  const machining::Correction c = testing::correct(e);
  EXPECT_GT(c.before.largest_distance, 3 * e.job.tolerance);
  EXPECT_TRUE(c.all_judged());
  EXPECT_THAT(c.text(), HasSubstr("ball 8 mm with 3 teeth"));
  expect_in_tube_at_both_cells(e, c);
}

// Ramps of 20 deg, down and up, with corners between them and level ways: their deflection is along z for the most
// part.
TEST(Ball, SlopesAreCorrected) {
  const Example e = groove(kSlope);
  const machining::Correction c = testing::correct(e);
  EXPECT_GT(c.before.largest_distance, 5 * e.job.tolerance);
  EXPECT_GT(c.transitions, 0);
  expect_in_tube_at_both_cells(e, c);
  expect_never_worse(e, c);
}

/// Lines of a spherical cap of radius 30 mm, to and fro, of segments of 1 mm.
std::string dome(double half, double between_lines) {
  constexpr double kRadius = 30, kTop = -0.3;
  std::string out = fmt::format("G21 G90 S12000 M3\nG0 X{} Y{} Z10\n", -half - 30, -half);
  const auto steps = static_cast<int>(2 * half);
  int line = 0;
  for (double y = -half; y <= half; y += between_lines, ++line) {
    for (int i = 0; i <= steps; ++i) {
      const double x = (line % 2 == 0 ? 1 : -1) * (i - half),
                   z = kTop - kRadius + std::sqrt(kRadius * kRadius - x * x - y * y);
      if (line == 0 && i == 0) out += fmt::format("G0 Z{:.4f}\nG1 F1800\n", z);
      out += fmt::format("G1 X{:.4f} Y{:.4f} Z{:.4f}\n", x, y, z);
    }
  }
  return out + "G0 Z10\nM2\n";
}

TEST(Ball, ADomeOfShortLinesIsCorrected) {
  const Example e = groove(dome(4, 0.5));
  const machining::Correction c = testing::correct(e);
  EXPECT_GT(c.before.largest_distance, 3 * e.job.tolerance);
  EXPECT_GT(c.rewritten_moves, 100);
  testing::expect_in_tube(e, c);
  expect_never_worse(e, c);
}

// Too much for the tube at its corners: what cannot be held is named, and nothing has become worse.
TEST(Ball, WhatCannotBeHeldIsSaid) {
  Example e = groove(
      "G21 G90 S12000 M3\nG0 X-45 Y0 Z10\nG0 Z-0.3\nG1 X-20 F1200\nG1 X-15 Z-2.1199\nG1 X-10 Z-0.3\nG0 Z10\nM2\n");
  e.job.tolerance = 20e-6;
  const machining::Correction c = testing::correct(e);
  EXPECT_FALSE(c.within_tolerance);
  EXPECT_THAT(c.reason, HasSubstr("line"));
  expect_never_worse(e, c);
}

// A command that goes on as a transition, in steps of teeth with the contacts on all sides, settles where the balance
// of a feed move stands, whose engagement is that of the way ahead.
TEST(Ball, ATransitionThatGoesOnIsAFeedMove) {
  const Example e = groove(
      "G21 G90 S12000 M3\nG0 X-45 Y0 Z10\nG0 Z0.5\nG1 X-20 F1200\nG1 X-8 Z-1.5\nG1 X4 Z-3.5\nG1 X16 Z-1.5\nM2\n");
  const LongVector<gcode::Move>& moves = e.interpretation.moves;
  ASSERT_EQ(moves.size(), 6u);
  const auto deflection_at_end = [&](std::size_t of, bool transition) {
    std::vector<machining::PassMove> commanded;
    for (const gcode::Move& move : moves) commanded.push_back({move, false, nullptr});
    commanded[of].transition = transition;
    cutting::Stock stock = e.job.stock;
    Vec3 out = Vec3::Zero();
    const auto visit = [&](const machining::Sample& s) {
      const bool inner = transition || s.s < moves[of].length() - 1e-3;  // before the corner
      if (static_cast<std::size_t>(s.move) == of && inner) out = s.deflection;
    };
    EXPECT_TRUE(machining::run_pass(e.job, e.program, commanded, stock, {}, visit));
    return out;
  };
  for (const std::size_t of : {std::size_t{4}, std::size_t{5}}) {
    const Vec3 feed = deflection_at_end(of, false), transition = deflection_at_end(of, true);
    EXPECT_GT(feed.norm(), 100e-6);
    EXPECT_LT((transition - feed).norm(), 0.1 * feed.norm()) << feed.transpose() << " and " << transition.transpose();
  }
}

Example bull_nose(const std::string& program, double corner_radius) {
  Example e = with_program("slavkovic_groove", program);
  e.job.cutter.corner_radius = corner_radius;
  return e;
}

TEST(BullNose, AGrooveIsTheClosedForm) {
  for (const double r : {0.5e-3, 2e-3}) {
    const Example e = bull_nose("G21 G90 S12000 M3\nG0 X-45 Y0 Z10\nG0 Z-1.5\nG1 X45 F1800\nG0 Z10\nM2\n", r);
    machining::PredictOptions options;
    options.bend = machining::Bend::at_rest;
    options.keep_samples = true;
    const machining::Prediction p = testing::predict(e, options);
    const Vec3 force =
        cutting::mean_force(e.job.cutter, e.job.material,
                            cutting::straight_slices(e.job.cutter, cutting::CutSide::slot, 0, 1.5e-3), 0.05e-3);
    int compared = 0;
    for (const machining::Sample& s : p.samples) {
      if (!s.cutting || std::abs(s.command.x()) > 20e-3) continue;
      EXPECT_LT((s.force - force).norm(), 0.02 * force.norm()) << s.force.transpose() << " and " << force.transpose();
      EXPECT_NEAR(s.depth, 1.5e-3, 1e-6);
      ++compared;
    }
    EXPECT_GT(compared, 60);
    EXPECT_THAT(p.notes, Contains(HasSubstr("the corner of a bull nose")));
  }
}

// Nearly no corner: what a flat cutter does.
TEST(BullNose, ASharpOneIsAFlatCutter) {
  const std::string program =
      "G21 G90 S12000 M3\nG0 X-25 Y-12 Z10\nG0 Z1\nG1 X-10 Z-2 F600\nG1 X10 F1800\nG3 X20 Y-2 I0 J10\nG0 Z10\nM2\n";
  const machining::Prediction flat = testing::predict(bull_nose(program, 0)),
                              sharp = testing::predict(bull_nose(program, 1e-7));
  ASSERT_EQ(flat.moves.size(), sharp.moves.size());
  EXPECT_GT(flat.largest_distance, 50e-6);
  EXPECT_NEAR(flat.largest_distance, sharp.largest_distance, 2e-7);
}

// A contour at two depths with an arc: in the tube, by passes of its own.
TEST(BullNose, IsCorrected) {
  const Example e = bull_nose(
      "G21 G90 S12000 M3\nG0 X-45 Y-12 Z10\nG0 Z-1\nG1 X10 F1800\nG3 X20 Y-2 I0 J10\nG1 Y40\nG0 Z10\nG0 X-45 Y-12\n"
      "G0 Z-2\nG1 X10\nG3 X20 Y-2 I0 J10\nG1 Y40\nG0 Z10\nM2\n",
      1.5e-3);
  const machining::Correction c = testing::correct(e);
  EXPECT_TRUE(c.within_tolerance) << c.reason;
  EXPECT_GT(c.before.largest_distance, 1.5 * c.largest_after);
  expect_in_tube_at_both_cells(e, c);
}

// Ramps whose thrust goes where they end: as near as may be, and never worse.
TEST(BullNose, RampsAreNeverWorse) {
  for (const double r : {0.5e-3, 1.5e-3}) {
    const Example e = bull_nose(
        "G21 G90 S12000 M3\nG0 X-25 Y-12 Z10\nG0 Z0.5\nG1 X-10 Z-1 F600\nG1 X10 F1800\nG1 X25 Z1\nG0 Z10\nM2\n", r);
    expect_never_worse(e, testing::correct(e));
  }
}

// Ends of plunges are those of a flat cutter: a dwell cuts them.
TEST(BullNose, EndsOfPlungesAreThoseOfAFlatCutter) {
  const std::string program = "G21 G90 S12000 M3\nG0 X0 Y0 Z10\nG0 Z1\nG1 Z-3 F1200\nG4 P2\nG0 Z10\nM2\n";
  const machining::Prediction flat = testing::predict(bull_nose(program, 0)),
                              corner = testing::predict(bull_nose(program, 1e-3));
  ASSERT_EQ(flat.plunges.size(), corner.plunges.size());
  EXPECT_NEAR(corner.largest_distance, flat.largest_distance, 0.05 * flat.largest_distance);
}

TEST(Ball, ACorrectedPlungeIsNotJudgedAtItsEnd) {
  const Example e = groove(
      "G21 G90 S12000 M3\nG0 X0 Y10 Z10\nG0 Z1\nG1 Z-0.6 F300\nG4 P2\nG0 Z10\nG0 X-45 Y0\nG0 Z-1\nG1 X45 F1200\nG0 "
      "Z10\n"
      "M2\n");
  const machining::Correction c = testing::correct(e);
  EXPECT_TRUE(c.within_tolerance) << c.reason;
  EXPECT_FALSE(c.all_judged());
  ASSERT_EQ(c.after.plunges.size(), 1u);
  EXPECT_TRUE(c.after.plunges[0].ball);
  EXPECT_THAT(c.answer(), HasSubstr("apart from what was not judged"));
}

// A cut that goes on from a plunge begins where the thrust holds the ball: that is no yes.
TEST(Ball, ACutThatGoesOnFromAPlungeBeginsAboveIt) {
  const Example e = groove("G21 G90 S12000 M3\nG0 X0 Y0 Z10\nG0 Z1\nG1 Z-2 F600\nG4 P2\nG1 X6 F1200\nG0 Z10\nM2\n");
  const machining::Correction c = testing::correct(e);
  EXPECT_FALSE(c.within_tolerance);
  EXPECT_THAT(c.reason, HasSubstr("line 6"));
  expect_never_worse(e, c);
}

// The thrust lifts a ball out of its plunge as it does a flat cutter; what a dwell does is not judged.
TEST(Ball, EndsOfPlungesAreNotJudged) {
  const Example e = groove("G21 G90 S12000 M3\nG0 X0 Y0 Z10\nG0 Z1\nG1 Z-3 F1200\nG4 P2\nG0 Z10\nM2\n");
  const machining::Prediction p = testing::predict(e);
  ASSERT_EQ(p.plunges.size(), 1u);
  EXPECT_EQ(p.plunges[0].needed, 0);
  EXPECT_EQ(p.plunges[0].remaining, p.plunges[0].held_back);
  EXPECT_THAT(p.plunges[0].why(), HasSubstr("tip of a ball"));
}

// The same groove with the tool tilted and all turned with it.
TEST(Ball, ATiltedBallIsTheSame) {
  const Example flat = groove("G21 G90 S12000 M3\nG0 X-45 Y-3 Z10\nG0 Z-2\nG1 X45 Y4 F1800\nG0 Z10\nM2\n");
  Example tilted = groove("G21 G90 S12000 M3\nG0 X-45 Y-10 Z-3 A90\nG0 Y2\nG1 X45 Z4 F1800\nG0 Y-10\nM2\n");
  lay_down(tilted);
  ASSERT_TRUE(machining::set_up(tilted.job, tilted.program, tilted.interpretation));
  const machining::Prediction a = testing::predict(flat), b = testing::predict(tilted);
  ASSERT_EQ(a.moves.size(), 1u);
  ASSERT_EQ(b.moves.size(), 1u);
  EXPECT_GT(a.moves[0].points, 100u);
  constexpr double kSame = 1e-8;
  EXPECT_NEAR(a.moves[0].normal.mean, b.moves[0].normal.mean, kSame);
  EXPECT_NEAR(a.moves[0].vertical.max, b.moves[0].vertical.max, kSame);
  EXPECT_NEAR(a.largest_distance, b.largest_distance, kSame);
  const machining::Correction upright = testing::correct(flat), turned = testing::correct(tilted);
  EXPECT_TRUE(turned.within_tolerance) << turned.reason;
  constexpr double kRounded = 1e-6;  // of written coordinates
  EXPECT_NEAR(upright.largest_distance, turned.largest_distance, kRounded);
  EXPECT_EQ(upright.pieces, turned.pieces);
}

// A ball that turns while it lies on its side.
TEST(Ball, ABallThatLiesIsRefused) {
  Example e = groove("G21 G90 S12000 M3\nG0 X-45 Y-10 Z-3 A90\nG0 Y2\nG1 X45 Z4 A80 F1800\nG0 Y-10\nM2\n");
  const auto set = machining::set_up(e.job, e.program, e.interpretation);
  ASSERT_FALSE(set);
  EXPECT_EQ(set.error().id, "MC213");
}

TEST(BullNose, AJobTakesOne) {
  testing::Scratch scratch;
  std::string text = *files::read(testing::example_path("slavkovic_groove", "job.toml"));
  const std::string length = "length_mm = 20";
  text.replace(text.find(length), length.size(), length + "\ncorner_radius_mm = 1");
  ASSERT_TRUE(files::write_whole(scratch.file("job.toml"), text));
  const auto job = machining::read_job(scratch.file("job.toml"));
  ASSERT_TRUE(job) << job.error().message;
  EXPECT_DOUBLE_EQ(job->cutter.corner_radius, 1e-3);
}

// A plunge that a dwell cuts to depth and whose tool stands beside it is outside, and judged.
TEST(BullNose, APlungeThatIsCutToDepthIsJudgedByWhereItStands) {
  Example e = bull_nose("G21 G90 S12000 M3\nG0 X0 Y0 Z10\nG0 Z1\nG1 Z-3 F1200\nG4 P2\nG0 Z10\nM2\n", 1e-3);
  e.job.tolerance = 1;  // all is within
  const machining::Prediction whole = testing::predict(e);
  ASSERT_EQ(whole.moves.size(), 1u);
  const double beside = whole.moves[0].largest_distance;
  ASSERT_GT(beside, 20e-6);
  e.job.tolerance = 0.7 * beside;
  const machining::Prediction p = testing::predict(e);
  EXPECT_TRUE(p.plunges.empty()) << p.plunges[0].why();
  EXPECT_FALSE(p.within(e.job));
}

// With the tool tilted and all turned with it.
TEST(BullNose, ATiltedOneIsTheSame) {
  const Example flat = bull_nose("G21 G90 S12000 M3\nG0 X-45 Y-3 Z10\nG0 Z-2\nG1 X45 Y4 F1800\nG0 Z10\nM2\n", 1e-3);
  Example tilted = bull_nose("G21 G90 S12000 M3\nG0 X-45 Y-10 Z-3 A90\nG0 Y2\nG1 X45 Z4 F1800\nG0 Y-10\nM2\n", 1e-3);
  lay_down(tilted);
  ASSERT_TRUE(machining::set_up(tilted.job, tilted.program, tilted.interpretation));
  const machining::Prediction a = testing::predict(flat), b = testing::predict(tilted);
  ASSERT_EQ(a.moves.size(), 1u);
  constexpr double kLayers = 1e-6;  // m: a tie between two layers of a cell falls the other way
  EXPECT_NEAR(a.largest_distance, b.largest_distance, kLayers);
}

}  // namespace
}  // namespace polypod
