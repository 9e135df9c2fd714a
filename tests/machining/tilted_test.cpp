// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Cuts with a tilted tool: one orientation in all of them.
#include "polypod/machining/tilted.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "machining/examples.hpp"
#include "polypod/core/units.hpp"
#include "polypod/machining/uncertainty.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod {
namespace {

using testing::Example;
using ::testing::HasSubstr;
using testing::load_example;
using testing::unwrap;
using testing::with_program;

constexpr double kPi = std::numbers::pi;

/// Base, workpiece and all: the machine of the job turned by Q about the origin of W.
void turn_machine(Example& e, const Mat3& Q) {
  auto arm = std::get<machine::SerialArm>(e.job.machine);
  const Vec3 o = e.job.X_MW.p;
  arm.X_MB = Pose{Q, o - Q * o} * arm.X_MB;
  e.job.machine = machine::AnyMachine(arm);
}

Status set_up(Example& e) {
  return machining::set_up(e.job, e.program, e.interpretation);
}

constexpr double kSame = 1e-9;  // m: a few roundings over a metre, through the machine's inverse

void expect_same(const machining::Prediction& flat, const machining::Prediction& tilted, const Mat3& Q) {
  ASSERT_EQ(flat.samples.size(), tilted.samples.size());
  ASSERT_GT(flat.deflection.count, 100u);
  EXPECT_NEAR(flat.pass.removed, tilted.pass.removed, 1e-6 * flat.pass.removed);
  EXPECT_NEAR(flat.largest_distance, tilted.largest_distance, kSame);
  for (std::size_t i = 0; i < flat.samples.size(); ++i) {
    const machining::Sample &a = flat.samples[i], &b = tilted.samples[i];
    EXPECT_LT((Q * a.command - b.command).norm(), kSame);
    EXPECT_LT((Q * a.deflection - b.deflection).norm(), kSame);
    EXPECT_LT((Q * a.force - b.force).norm(), 1e-4);
    EXPECT_LT((Q * a.away - b.away).norm(), 1e-9);
    EXPECT_NEAR(a.normal, b.normal, kSame);
    EXPECT_NEAR(a.vertical, b.vertical, kSame);
    EXPECT_NEAR(a.distance, b.distance, kSame);
    EXPECT_EQ(a.cutting, b.cutting);
  }
  ASSERT_EQ(flat.moves.size(), tilted.moves.size());
  for (std::size_t i = 0; i < flat.moves.size(); ++i)
    EXPECT_NEAR(flat.moves[i].normal.mean, tilted.moves[i].normal.mean, kSame);
  EXPECT_EQ(flat.plunges.size(), tilted.plunges.size());
  EXPECT_EQ(flat.not_judged.size(), tilted.not_judged.size());
}

// A groove with an arc, a plunge and a retract, and the same with machine, block and program turned by 90 deg about x:
// A90 in the program, arcs in G18. Nothing physical has changed.
constexpr const char* kFlat =
    "G21 G90 G17 S12000 M3\nG0 X-20 Y-10 Z10\nG0 Z1\nG1 Z-2 F300\nG1 X-10 F1800\nG2 X10 Y-10 I10 J0\nG1 X20 Y5\n"
    "G1 X45\nG0 Z10\nM2\n";
constexpr const char* kTurned =
    "G21 G90 G18 S12000 M3\nG0 X-20 Y-10 Z-10 A90\nG0 Y-1\nG1 Y2 F300\nG1 X-10 F1800\nG3 X10 Z-10 I10 K0\nG1 X20 Z5\n"
    "G1 X45\nG0 Y-10\nM2\n";

Example turned_by_90() {
  Example e = with_program("slavkovic_groove", kTurned);
  const double cell = e.job.stock.cell();
  e.job.stock = unwrap(cutting::Stock::block({-30e-3, 0, -20e-3}, {30e-3, 20e-3, 20e-3}, cell));
  turn_machine(e, rotation_x(kPi / 2));
  return e;
}

TEST(Tilted, TheWholeTurnedByARightAngleIsTheSame) {
  const Example flat = with_program("slavkovic_groove", kFlat);
  Example tilted = turned_by_90();
  ASSERT_TRUE(set_up(tilted));
  EXPECT_TRUE(tilted.job.tool_frame.tilted);
  for (const machining::Bend bend : {machining::Bend::at_rest, machining::Bend::equilibrium}) {
    machining::PredictOptions options;
    options.bend = bend;
    options.keep_samples = true;
    expect_same(testing::predict(flat, options), testing::predict(tilted, options), rotation_x(kPi / 2));
  }
}

TEST(Tilted, TheCorrectionIsTurnedToo) {
  const Example flat = with_program("slavkovic_groove", kFlat);
  Example tilted = turned_by_90();
  ASSERT_TRUE(set_up(tilted));
  const machining::Correction a = testing::correct(flat), b = testing::correct(tilted);
  EXPECT_EQ(a.within_tolerance, b.within_tolerance);
  EXPECT_EQ(a.lines_out, b.lines_out);
  EXPECT_EQ(a.pieces, b.pieces);
  EXPECT_EQ(a.transitions, b.transitions);
  ASSERT_EQ(a.commanded.size(), b.commanded.size());
  for (std::size_t i = 0; i < a.commanded.size(); ++i) {
    EXPECT_LT((rotation_x(kPi / 2) * a.commanded[i].move.end - b.commanded[i].move.end).norm(), 1e-6);
    EXPECT_EQ(b.commanded[i].move.axes_end.x(), kPi / 2);
  }
  EXPECT_NEAR(a.largest_distance, b.largest_distance, 1e-6);  // what is written is rounded
  EXPECT_NEAR(a.before.largest_distance, b.before.largest_distance, kSame);
}

// The same by any angle, with the heights along the tool given: lines, a plunge, a ramp.
TEST(Tilted, TheWholeTurnedByAnyAngleIsTheSame) {
  const std::vector<Vec3> points{{-20e-3, -10e-3, 10e-3}, {-20e-3, -10e-3, 1e-3}, {-20e-3, -10e-3, -2e-3},
                                 {-5e-3, -8e-3, -2e-3},   {10e-3, 6e-3, -2.5e-3}, {45e-3, 6e-3, -2.5e-3},
                                 {45e-3, 6e-3, 10e-3}};
  const auto program = [&](const Mat3& Q, const std::string& axes) {
    std::string text = "G21 G90 S12000 M3\n";
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Vec3 p = 1e3 * Q * points[i];
      const bool rapid = i < 2 || i + 1 == points.size();
      text += fmt::format("{} X{:.12f} Y{:.12f} Z{:.12f}{}\n", rapid ? "G0" : "G1", p.x(), p.y(), p.z(),
                          i == 0   ? axes
                          : i == 2 ? " F300"
                          : i == 3 ? " F1800"
                                   : "");
    }
    return text + "M2\n";
  };
  const Example flat = with_program("slavkovic_groove", program(Mat3::Identity(), ""));
  machining::PredictOptions options;
  options.keep_samples = true;
  const machining::Prediction expected = testing::predict(flat, options);
  const std::vector<std::pair<double, double>> angles{{30, 0}, {0, 25}, {-20, 15}};
  for (const auto& [A, B] : angles) {
    SCOPED_TRACE(fmt::format("A{} B{}", A, B));
    const Mat3 Q = rotation_abc(units::from_deg(A), units::from_deg(B), 0);
    Example tilted = with_program("slavkovic_groove", program(Q, fmt::format(" A{} B{}", A, B)));
    machining::ToolFrame& tool = tilted.job.tool_frame;
    tool.tilted = true;
    tool.axes = {units::from_deg(A), units::from_deg(B), 0};
    tool.R_MT = tool.R_WS = Q;
    tool.stock_in_W = {Vec3::Constant(-0.05), Vec3::Constant(0.05)};
    turn_machine(tilted, Q);
    machining::Prediction found = testing::predict(tilted, options);
    // The box of a turned block is larger: more rapids beside it cannot be said to stay clear.
    found.not_judged = expected.not_judged;
    expect_same(expected, found, Q);
  }
}

// A groove along x, level in W, with the tool leaning across it: forces by a sum over tooth angles of a wedge whose top
// is the upper face of the block, deflections by the compliance of the machine in that orientation.
TEST(Tilted, ALeaningGrooveIsTheClosedForm) {
  for (const double A : {10.0, -15.0}) {
    SCOPED_TRACE(A);
    Example e =
        with_program("slavkovic_groove",
                     fmt::format("G21 G90 S12000 M3\nG0 X-45 Y0 Z12 A{}\nG0 Z-2\nG1 X45 F1800\nG0 Z12\nM2\n", A));
    ASSERT_TRUE(set_up(e));
    const Mat3 R = rotation_x(units::from_deg(A));
    EXPECT_LT((e.job.tool_frame.R_MT - R).norm(), 1e-15);
    machining::PredictOptions options;
    options.keep_samples = true;
    options.bend = machining::Bend::at_rest;
    const machining::Prediction p = testing::predict(e, options);
    // In S the upper face is z = (0 - n_y y) / n_z with n = R^T z, the tip at R^T (x, 0, -2 mm).
    const Vec3 n = R.transpose().col(2), tip = R.transpose() * Vec3(0, 0, -2e-3);
    const double radius = e.job.cutter.radius(), feed = 0.03 / (200 * 3);
    const cutting::Material& m = e.job.material;
    Vec3 force = Vec3::Zero();
    constexpr int kSteps = 20000;
    for (int i = 0; i < kSteps; ++i) {
      const double phi = kPi * (i + 0.5) / kSteps, u = tip.y() + radius * std::cos(phi);
      const double a = std::max(0.0, -n.y() / n.z() * u - tip.z()), h = feed * std::sin(phi);
      const double t = m.kte + m.ktc * h, r = m.kre + m.krc * h, ax = m.kae + m.kac * h;
      force += a * Vec3(-t * std::cos(phi) - r * std::sin(phi), t * std::sin(phi) - r * std::cos(phi), ax);
    }
    force = R * Vec3(e.job.cutter.teeth / (2 * kPi) * kPi / kSteps * force);
    int compared = 0;
    for (const machining::Sample& s : p.samples) {
      if (!s.cutting || std::abs(s.command.x()) > 20e-3) continue;
      EXPECT_LT((s.force - force).norm(), 0.015 * force.norm());
      const auto c = statics::compliance_at(e.job.machine, Pose{R, e.job.X_MW * s.command});
      ASSERT_TRUE(c.reachable);
      EXPECT_LT((s.deflection - c.displacement(s.force)).norm(), 1e-9);
      EXPECT_LT((s.away - R.col(1)).norm(), 1e-12);
      ++compared;
    }
    EXPECT_GT(compared, 60);
    EXPECT_TRUE(p.not_judged.empty());
  }
}

// Every dense point of the corrected program by a pass of its own and a plain search for the nearest point.
TEST(Tilted, AnInclinedContourIsCorrected) {
  Example e = load_example("inclined_contour");
  ASSERT_TRUE(set_up(e));
  const machining::Correction c = testing::correct(e);
  EXPECT_GT(c.before.largest_distance, e.job.tolerance);
  testing::expect_in_tube(e, c);
  EXPECT_TRUE(c.before.not_judged.empty());
  for (const machining::PassMove& move : c.commanded) {
    if (move.move.kind == gcode::MoveKind::rapid) continue;
    EXPECT_LT((move.move.axes_end - e.job.tool_frame.axes).norm(), 1e-12);
  }
}

// The uncertainty of the compliances is taken in the orientation of the cut: with one compliance alone it is the
// deflection itself times its relative uncertainty.
TEST(Tilted, TheUncertaintyIsThatOfTheOrientation) {
  Example e =
      with_program("slavkovic_groove", "G21 G90 S12000 M3\nG0 X-45 Y0 Z12 A10\nG0 Z-2\nG1 X45 F1800\nG0 Z12\nM2\n");
  auto arm = std::get<machine::SerialArm>(e.job.machine);
  for (std::size_t i = 0; i < arm.dh.size(); ++i) arm.dh[i].compliance = i == 0 ? 1e-6 : 0;
  e.job.machine = machine::AnyMachine(arm);
  ASSERT_TRUE(set_up(e));
  machining::PredictOptions options;
  options.bend = machining::Bend::at_rest;
  const machining::Prediction p = testing::predict(e, options);
  Eigen::MatrixXd S = Eigen::MatrixXd::Zero(5, 5);
  S(0, 0) = 1e-14;  // a tenth of the compliance
  const machining::ComplianceBand band = machining::compliance_band(e.job, p, S);
  double largest = 0;
  for (const machining::Sample& s : p.few)
    if (!s.away.isZero(0)) largest = std::max(largest, 2 * 0.1 * std::abs(s.deflection.dot(s.away)));
  EXPECT_NEAR(band.normal.max, largest, 1e-6 * largest);
}

struct BadCase {
  const char* what;
  const char* program;
  const char* id;
  int line;
};

TEST(Tilted, WhatCannotBeSetUpIsNamedWithItsLine) {
  const BadCase cases[] = {
      {"turns in a cut", "G21 G90 S8000 M3\nG0 X-45 Y0 Z20 A10\nG0 Z-2\nG1 X45 A12 F1600\nM2\n", "MC206", 4},
      {"two orientations",
       "G21 G90 S8000 M3\nG0 X-45 Y0 Z20 A10\nG0 Z-2\nG1 X45 F1600\nG0 Z20\nG0 X-45 A15\nG0 Z-3\nG1 X45\nM2\n", "MC207",
       8},
  };
  for (const BadCase& c : cases) {
    SCOPED_TRACE(c.what);
    Example e = with_program("slavkovic_groove", c.program);
    const Status s = set_up(e);
    ASSERT_FALSE(s);
    EXPECT_EQ(s.error().id, c.id);
    EXPECT_EQ(s.error().place.line, c.line);
    EXPECT_EQ(s.error().place.file, "test.ngc");
  }
}

TEST(Tilted, StocksThatAreNoBlockAreRefused) {
  Example e = with_program("slavkovic_groove", "G21 G90 S8000 M3\nG0 X-45 Y0 Z20 A10\nG0 Z-2\nG1 X45 F1600\nM2\n");
  e.job.stock.cut_disc({0, 0, -5e-3}, 4e-3);
  const Status s = set_up(e);
  ASSERT_FALSE(s);
  EXPECT_EQ(s.error().id, "MC209");
  EXPECT_EQ(s.error().place.line, 4);
}

// Without the set-up, as other commands have it, a tilted cut is still refused.
TEST(Tilted, WithoutTheSetUpItIsRefused) {
  const Example e =
      with_program("slavkovic_groove", "G21 G90 S8000 M3\nG0 X-45 Y0 Z20 A10\nG0 Z-2\nG1 X45 F1600\nM2\n");
  const auto p = machining::predict(e.job, e.program, e.interpretation);
  ASSERT_FALSE(p);
  EXPECT_EQ(p.error().id, "MC204");
  EXPECT_EQ(p.error().place.line, 4);
}

// A set-up for another orientation refuses as well.
TEST(Tilted, AnotherOrientationThanThatOfTheSetUpIsRefused) {
  Example e = with_program("slavkovic_groove", "G21 G90 S8000 M3\nG0 X-45 Y0 Z20 A10\nG0 Z-2\nG1 X45 F1600\nM2\n");
  ASSERT_TRUE(set_up(e));
  const Example other =
      with_program("slavkovic_groove", "G21 G90 S8000 M3\nG0 X-45 Y0 Z20\nG0 Z-2\nG1 X45 F1600\nM2\n");
  const auto p = machining::predict(e.job, other.program, other.interpretation);
  ASSERT_FALSE(p);
  EXPECT_EQ(p.error().id, "MC204");
  EXPECT_THAT(p.error().message, HasSubstr("A 0 B 0 deg"));
}

// Moves that turn the tool above the block pass; a rapid that turns it beside the material is not judged.
TEST(Tilted, TurnsAboveTheBlockAreFree) {
  const char* above =
      "G21 G90 S12000 M3\nG0 Z20\nG0 X-45 Y0\nG0 A10\nG0 Z-2\nG1 X45 F1800\nG0 Z20\nG0 A0\nG1 X0 F1800\nM2\n";
  Example e = with_program("slavkovic_groove", above);
  ASSERT_TRUE(set_up(e));
  EXPECT_TRUE(testing::predict(e).not_judged.empty());
  Example beside =
      with_program("slavkovic_groove",
                   "G21 G90 S12000 M3\nG0 Z20\nG0 X-45 Y0\nG0 A10\nG0 Z-2\nG1 X45 F1800\nG0 X20 A0\nG0 Z20\nM2\n");
  ASSERT_TRUE(set_up(beside));
  const machining::Prediction p = testing::predict(beside);
  ASSERT_FALSE(p.not_judged.empty());
  EXPECT_EQ(p.not_judged.front().line, 7);
  EXPECT_FALSE(p.within(beside.job));
}

// A tool that leans towards a face is clear of it only as far as its disc and its axis are.
TEST(Tilted, StaysClearIsTheGeometryOfADiscAndItsAxis) {
  Example e = load_example("slavkovic_groove");  // the block's top is z = 0, its side x = 30 mm
  const double R = e.job.cutter.radius();
  gcode::Move move;
  move.kind = gcode::MoveKind::line;
  const auto clear = [&](const Vec3& at, double A, double B) {
    move.start = move.end = at;
    move.end.y() += 1e-3;
    move.axes_start = move.axes_end = {units::from_deg(A), units::from_deg(B), 0};
    return machining::stays_clear(e.job, move);
  };
  EXPECT_TRUE(clear({0, 0, 1e-6}, 0, 0));
  EXPECT_FALSE(clear({0, 0, -1e-6}, 0, 0));
  EXPECT_TRUE(clear({30e-3 + R + 1e-6, 0, -5e-3}, 0, 0));
  EXPECT_FALSE(clear({30e-3 + R - 1e-6, 0, -5e-3}, 0, 0));
  EXPECT_TRUE(clear({0, 0, R * std::sin(units::from_deg(20)) + 1e-6}, 20, 0));
  EXPECT_FALSE(clear({0, 0, R * std::sin(units::from_deg(20)) - 1e-6}, 20, 0));
  EXPECT_TRUE(clear({30e-3 + R * std::cos(units::from_deg(20)) + 1e-6, 0, -5e-3}, 0, 20));  // leans away in x
  EXPECT_FALSE(clear({60e-3, 0, -5e-3}, 0, -20));                                           // leans over it
}

// C counts from M however the part is turned about z of M, as LinuxCNC runs the program and `post` writes it: the tool
// stands as it stood, and with it the compliance.
TEST(Tilted, APartThatIsTurnedDoesNotTurnTheToolAboutItsAxis) {
  for (const double deg : {0.0, 15.0}) {
    Example e = load_example("slavkovic_groove");
    e.job.machine = unwrap(machine::load("hexapod-f100i"));
    e.job.X_MW = {rotation_z(units::from_deg(deg)), Vec3(0, 0, 1.1)};
    const machining::Prediction p = testing::predict(e);
    ASSERT_GT(p.few.size(), 10u);
    double same = 0, turned = 0;
    for (const machining::Sample& s : p.few) {
      const Vec3 at = e.job.X_MW * s.command;
      const auto deflection = [&](const Mat3& R_MT) {
        const Mat3 C = statics::compliance_at(e.job.machine, {R_MT, at}).linear();
        return Vec3(e.job.X_MW.R.transpose() * C * e.job.X_MW.R * s.force);
      };
      same = std::max(same, (deflection(Mat3::Identity()) - s.deflection).norm() / s.deflection.norm());
      turned = std::max(turned, (deflection(e.job.X_MW.R) - s.deflection).norm() / s.deflection.norm());
    }
    EXPECT_LT(same, 5e-3);  // the equilibrium is one iteration away
    if (deg > 0) {
      EXPECT_GT(turned, 0.02);
    }
  }
}

}  // namespace
}  // namespace polypod
