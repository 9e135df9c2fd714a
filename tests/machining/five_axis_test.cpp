// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Balls that turn while they cut.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "cutting/ball_by_points.hpp"
#include "machining/examples.hpp"
#include "polypod/core/units.hpp"
#include "polypod/machining/check.hpp"
#include "polypod/machining/compare.hpp"
#include "polypod/machining/place.hpp"
#include "polypod/machining/tilted.hpp"
#include "polypod/machining/uncertainty.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod {
namespace {

using testing::Example;
using ::testing::HasSubstr;
using testing::with_program;

constexpr double kR = 4e-3;  // of the ball

Example ball(const std::string& program) {
  Example e = with_program("slavkovic_groove", program);
  e.job.cutter.corner_radius = e.job.cutter.radius();
  return e;
}

Status set_up(Example& e) {
  return machining::set_up(e.job, e.program, e.interpretation);
}

/// The axis of the tool of a machine with A and B of its own.
Vec3 axis(const Vec3& axes) {
  return rotation_abc(axes.x(), axes.y(), 0).col(2);
}

/// Lines over a spherical cap of radius 250 mm with its top 0.3 mm below the block's, to and fro, from outside of the
/// block to outside, of blocks of 2 mm. The tool leads: it leans by `lead_deg` from the normal of the surface in the
/// direction of the feed, and turns with both. All of it turned by Q.
std::string cap(double half, double between_lines, double lead_deg, const Mat3& Q = Mat3::Identity()) {
  constexpr double kRadius = 250, kTop = -0.3, kBall = 4, kReach = 36, kBlock = 2;
  const double lead = units::from_deg(lead_deg);
  std::string out = "G21 G90 S12000 M3\n";
  int line = 0;
  for (double y = -half; y <= half + 1e-9; y += between_lines, ++line) {
    const double sense = line % 2 == 0 ? 1 : -1;
    const auto steps = static_cast<int>(2 * kReach / kBlock);
    for (int i = 0; i <= steps; ++i) {
      const double x = sense * (-kReach + kBlock * i);
      const Vec3 n = Vec3(x, y, std::sqrt(kRadius * kRadius - x * x - y * y)) / kRadius;
      Vec3 along(sense, 0, 0);
      along = (along - n * n.dot(along)).normalized();
      const Vec3 u = Q * (std::cos(lead) * n + std::sin(lead) * along);
      const Vec3 tip = Q * (kRadius * n + Vec3(0, 0, kTop - kRadius) + kBall * n) - kBall * u;
      const double A = -units::to_deg(std::asin(u.y())), B = units::to_deg(std::atan2(u.x(), u.z()));
      if (i == 0) {
        out += fmt::format("G0 X{:.4f} Y{:.4f} Z20 A{:.4f} B{:.4f}\nG0 Z{:.4f}\nG1 F1200\n", tip.x(), tip.y(), A, B,
                           tip.z());
      } else {
        out += fmt::format("G1 X{:.4f} Y{:.4f} Z{:.4f} A{:.4f} B{:.4f}\n", tip.x(), tip.y(), tip.z(), A, B);
      }
    }
    out += "G0 Z20\n";
  }
  return out + "M2\n";
}

TEST(FiveAxes, ABallThatTurnsIsSetUp) {
  Example e = ball(cap(4, 2, 15));
  ASSERT_TRUE(set_up(e));
  EXPECT_TRUE(e.job.tool_frame.turns);
  EXPECT_FALSE(e.job.tool_frame.tilted);
}

// A turn by a thousandth of a degree changes nothing; the way there goes through the functions of a tool that leans.
TEST(FiveAxes, ATurnOfNothingIsTheUprightTool) {
  constexpr const char* kWay =
      "G21 G90 S12000 M3\nG0 X-45 Y-3 Z10\nG0 Z-1.5\nG1 X-10 Y4{} F1800\nG1 X20 Y-5 Z-1\nG1 X45\nG0 Z10\nM2\n";
  const Example flat = ball(fmt::format(fmt::runtime(kWay), ""));
  Example turning = ball(fmt::format(fmt::runtime(kWay), " A0.001 B-0.001"));
  ASSERT_TRUE(set_up(turning));
  ASSERT_TRUE(turning.job.tool_frame.turns);
  const machining::Prediction a = testing::predict(flat), b = testing::predict(turning);
  ASSERT_EQ(a.moves.size(), b.moves.size());
  constexpr double kSame = 1.5e-6;  // rings and sectors meet the cells a little differently
  for (std::size_t i = 0; i < a.moves.size(); ++i) {
    EXPECT_NEAR(a.moves[i].normal.mean, b.moves[i].normal.mean, kSame);
    EXPECT_NEAR(a.moves[i].vertical.mean, b.moves[i].vertical.mean, kSame);
    EXPECT_NEAR(a.moves[i].largest_distance, b.moves[i].largest_distance, 2 * kSame);
  }
  EXPECT_NEAR(a.pass.removed, b.pass.removed, 2e-3 * a.pass.removed);
}

// The force of a groove by a sum over points of the leaning ball, and the compliance of the machine in its orientation.
TEST(FiveAxes, ForceAndComplianceAreThoseOfTheOrientation) {
  // B turns from 10 to 30 deg while the middle of the ball goes along x at y 0, z 2.5: a groove of 1.5 mm.
  std::string program = "G21 G90 S12000 M3\n";
  for (int i = 0; i <= 60; ++i) {
    const double B = 10 + 20 * i / 60.0, x = -30 + i;
    const Vec3 tip = Vec3(x, 0, 2.5) - 4 * axis({0, units::from_deg(B), 0});
    program +=
        fmt::format("G{} X{:.5f} Y0 Z{:.5f} B{:.5f} {}\n", i == 0 ? 0 : 1, tip.x(), tip.z(), B, i == 1 ? "F1800" : "");
  }
  Example e = ball(program + "G0 Z20\nM2\n");
  ASSERT_TRUE(set_up(e));
  machining::PredictOptions options;
  options.bend = machining::Bend::at_rest;
  options.keep_samples = true;
  const machining::Prediction p = testing::predict(e, options);
  int compared = 0;
  for (const machining::Sample& s : p.samples) {
    if (!s.cutting || std::abs(s.command.x()) > 15e-3 || ++compared % 10 != 0) continue;
    const gcode::Move& move = e.interpretation.moves[static_cast<std::size_t>(s.move)];
    const Mat3 R = rotation_abc(s.axes.x(), s.axes.y(), 0);
    EXPECT_NEAR(s.axes.y(), units::from_deg(10 + 20 * (s.command.x() + kR * R.col(2).x() + 30e-3) / 60e-3), 1e-4);
    // The middle goes 1 mm a block, in the time in which the tip goes its length.
    const double per_tooth = move.feed / (move.spindle_speed * 3) * 1e-3 / move.length();
    constexpr int kSteps = 300;
    constexpr double kDepth = 1.5e-3;  // m
    const Vec3 force = cutting::samples::by_points(
        e.job.cutter, e.job.material, R, Vec3::UnitX(), per_tooth, [&](const Vec3& q) { return q.z() < kDepth; },
        kSteps);
    EXPECT_LT((s.force - force).norm(), 0.05 * force.norm()) << s.force.transpose() << " for " << force.transpose();
    const auto c = statics::compliance_at(e.job.machine, Pose{R, e.job.X_MW * s.command});
    EXPECT_LT((s.deflection - c.displacement(s.force)).norm(), 1e-9);
  }
  EXPECT_GT(compared, 50);
}

/// Where the middle of the ball really goes against the programmed middle, by passes of its own and plain searches.
double farthest_middle(const Example& e, const machining::Correction& c) {
  cutting::Stock stock = e.job.stock;
  machining::PassOptions options;
  options.step = 0.4e-3;  // not the corrector's own step
  double worst = 0;
  std::size_t points = 0;
  const auto visit = [&](const machining::Sample& s) {
    if (!s.cutting) return;
    ++points;
    double nearest = 1;
    const int source = c.source[static_cast<std::size_t>(s.move)];
    const Vec3 middle = s.bent() + kR * axis(s.axes);
    for (int i = std::max(0, source - 1); i <= source + 1; ++i) {
      if (i >= static_cast<int>(e.interpretation.moves.size())) continue;
      const gcode::Move& move = e.interpretation.moves[static_cast<std::size_t>(i)];
      if (move.kind == gcode::MoveKind::rapid) continue;
      constexpr int kPlaces = 2000;
      for (int k = 0; k <= kPlaces; ++k) {
        const double share = double(k) / kPlaces;
        const Vec3 axes = move.axes_start + share * (move.axes_end - move.axes_start);
        nearest = std::min(nearest, (middle - move.point(share * move.length()) - kR * axis(axes)).norm());
      }
    }
    worst = std::max(worst, nearest);
  };
  const auto result = machining::run_pass(e.job, c.program, c.commanded, stock, options, visit);
  EXPECT_TRUE(result) << to_string(result.error());
  EXPECT_GT(points, 200u);
  return worst;
}

// A spherical cap in five axes: every dense point within the tube, of the middle of the ball too, after re-reading.
TEST(FiveAxes, ASphericalCapIsCorrected) {
  Example e = ball(cap(4, 2, 15));
  ASSERT_TRUE(set_up(e));
  const machining::Correction c = testing::correct(e);
  EXPECT_GT(c.before.largest_distance, 2 * e.job.tolerance);
  EXPECT_GT(c.rewritten_moves, 50);
  EXPECT_TRUE(c.within_tolerance) << c.reason;
  EXPECT_TRUE(c.all_judged()) << c.answer();
  EXPECT_THAT(c.text(), HasSubstr(" A"));
  constexpr double kSlack = 4e-6;  // another step meets other cells of the stock
  EXPECT_LE(farthest_middle(e, c), e.job.tolerance + kSlack);
  for (const machining::MoveOutcome& m : c.moves)
    EXPECT_LE(m.distance_after, std::max(m.distance_before + 1e-6, e.job.tolerance)) << "line " << m.line;
}

// Lines in all directions at several depths, with turns in some of them: never worse, and what is called within is.
TEST(FiveAxes, RandomProgramsAreNeverWorseAndWithinIsTrue) {
  int within = 0;
  for (unsigned seed = 1; seed <= 4; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937 random(seed);
    const auto between = [&](double low, double high) {
      return std::uniform_real_distribution<double>(low, high)(random);
    };
    std::string program =
        fmt::format("G21 G90 S12000 M3\nG0 X-40 Y{:.3f} Z10 A{:.3f} B{:.3f}\nG0 Z{:.3f}\nG1 F{:.0f}\n",
                    between(-10, 10), between(-15, 15), between(-15, 15), between(-1.2, -0.4), between(800, 1600));
    double x = -40;
    while (x < 38) {
      x += between(5, 14);
      program += fmt::format("X{:.3f} Y{:.3f} Z{:.3f}", x, between(-10, 10), between(-1.5, -0.3));
      if (between(0, 1) < 0.7) program += fmt::format(" A{:.3f} B{:.3f}", between(-15, 15), between(-15, 15));
      program += "\n";
    }
    Example e = ball(program + "G0 Z20\nM2\n");
    ASSERT_TRUE(set_up(e));
    const machining::Correction c = testing::correct(e);
    EXPECT_LE(c.largest_distance, c.before.largest_distance + 1e-6);
    for (const machining::MoveOutcome& m : c.moves)
      EXPECT_LE(m.distance_after, std::max(m.distance_before + 1e-6, e.job.tolerance)) << "line " << m.line;
    if (!c.within_tolerance) continue;
    ++within;
    EXPECT_LE(farthest_middle(e, c), e.job.tolerance + 4e-6);
  }
  EXPECT_GT(within, 1);
}

// The whole turned about z: base of the machine, block and program, whose A and B become others. Nothing physical has
// changed; the sectors in which the tool is seen lie elsewhere.
TEST(FiveAxes, TheWholeTurnedIsTheSame) {
  const Mat3 Q = rotation_z(units::from_deg(90));
  Example straight = ball(cap(4, 2, 15)), turned = ball(cap(4, 2, 15, Q));
  turned.job.stock =
      testing::unwrap(cutting::Stock::block({-20e-3, -30e-3, -20e-3}, {20e-3, 30e-3, 0}, straight.job.stock.cell()));
  auto arm = std::get<machine::SerialArm>(turned.job.machine);
  const Vec3 o = turned.job.X_MW.p;
  arm.X_MB = Pose{Q, o - Q * o} * arm.X_MB;
  turned.job.machine = machine::AnyMachine(arm);
  ASSERT_TRUE(set_up(straight));
  ASSERT_TRUE(set_up(turned));
  const machining::Prediction a = testing::predict(straight), b = testing::predict(turned);
  ASSERT_EQ(a.moves.size(), b.moves.size());
  EXPECT_GT(a.largest_distance, 100e-6);
  EXPECT_NEAR(a.pass.removed, b.pass.removed, 1e-3 * a.pass.removed);
  for (std::size_t i = 0; i < a.moves.size(); ++i) {
    EXPECT_EQ(a.moves[i].line, b.moves[i].line);
    EXPECT_NEAR(a.moves[i].largest_distance, b.moves[i].largest_distance, 0.03 * a.moves[i].largest_distance + 1e-6);
    EXPECT_NEAR(a.moves[i].vertical.mean, b.moves[i].vertical.mean, 0.03 * a.moves[i].deflection.mean + 1e-6)
        << "line " << a.moves[i].line;
  }
}

TEST(FiveAxes, WhatIsNotKnownIsRefused) {
  const struct {
    const char* program;
    const char* id;
    const char* says;
  } cases[] = {
      {"G21 G90 S12000 M3\nG0 X-45 Y0 Z10\nG0 Z-1.5\nG1 X-10 F1800\nG1 B20\nG1 X45\nG0 Z10\nM2\n", "MC206",
       "on the spot"},
      {"G21 G90 S12000 M3\nG0 X-45 Y0 Z10 B70\nG0 Z-1.5\nG1 X45 B85 F1800\nG0 Z10\nM2\n", "MC213",
       "tilted by 85.0 deg"},
  };
  for (const auto& test : cases) {
    Example e = ball(test.program);
    const Status set = set_up(e);
    ASSERT_FALSE(set) << test.program;
    EXPECT_EQ(set.error().id, test.id);
    EXPECT_THAT(set.error().message, HasSubstr(test.says));
  }
  // A cylinder that turns; the ball of the same program does not mind.
  Example flat =
      with_program("slavkovic_groove", "G21 G90 S12000 M3\nG0 X-45 Y0 Z10\nG0 Z-1.5\nG1 X45 B5 F1800\nG0 Z10\nM2\n");
  const Status set = set_up(flat);
  ASSERT_FALSE(set);
  EXPECT_EQ(set.error().id, "MC206");
  EXPECT_THAT(set.error().hint, HasSubstr("ball end mill"));
}

// Places of a program whose tool turns, and of one whose tool is tilted: what predict says of a job that lies there.
TEST(FiveAxes, APlaceHasTheErrorThatPredictGivesThere) {
  for (const char* example : {"five_axis_cap", "inclined_contour"}) {
    SCOPED_TRACE(example);
    const Example given = testing::load_example(example);
    Example e = given;
    ASSERT_TRUE(set_up(e));
    machining::PlaceOptions options;
    const Vec3 o = e.job.X_MW.p;
    for (int k = 0; k < 3; ++k) options.box[static_cast<std::size_t>(k)] = machine::JointRange{o[k] - 0.1, o[k] + 0.1};
    options.resolution = 3;
    options.judged = 2;
    const machining::PlaceResult r =
        testing::unwrap(machining::best_place(e.job, e.program, e.interpretation, options));
    ASSERT_TRUE(r.best && r.start_error);
    EXPECT_TRUE(r.held);
    EXPECT_LT(r.best->error, 0.97 * *r.start_error);
    ASSERT_GE(r.judged.size(), 2u);
    for (const machining::JudgedPlace& j : r.judged) {
      Example there = given;
      there.job.X_MW = j.at.pose();
      ASSERT_TRUE(set_up(there));
      const machining::Prediction p = testing::predict(there);
      EXPECT_NEAR(j.error, std::max(std::abs(p.normal.min), std::abs(p.normal.max)), 1e-9);
      EXPECT_NEAR(j.distance, p.largest_distance, 1e-9);
      EXPECT_NEAR(j.estimate, j.error, 0.15 * j.error);
      EXPECT_NEAR(j.distance_estimate, j.distance, 0.15 * j.distance);
    }
    // By the distance in space, in which the vertical part counts, another place is the best, and a nearer one.
    machining::PlaceOptions in_space = options;
    in_space.by = machining::PlaceBy::distance;
    const machining::PlaceResult near =
        testing::unwrap(machining::best_place(e.job, e.program, e.interpretation, in_space));
    ASSERT_TRUE(near.best && near.start_distance);
    EXPECT_LE(near.best->distance, r.best->distance);
    EXPECT_LE(near.best->distance, *near.start_distance);
    EXPECT_FALSE(near.farther_there());
    for (std::size_t k = 1; k < near.judged.size(); ++k) {
      EXPECT_LE(near.judged[k - 1].distance, near.judged[k].distance);
    }
    EXPECT_EQ(r.farther_there(), r.best->distance > *r.start_distance + 1e-6);
    // A and B do not turn with the part; a whole turn is none.
    options.turns = machine::JointRange{units::from_deg(360), units::from_deg(360)};
    EXPECT_TRUE(machining::best_place(e.job, e.program, e.interpretation, options));
    options.turns = machine::JointRange{0, 1};
    const auto turned = machining::best_place(e.job, e.program, e.interpretation, options);
    ASSERT_FALSE(turned);
    EXPECT_EQ(turned.error().id, "MC402");
  }
}

// Where A and B are the machine's own, `check` offers no turn of a part that is cut with a tilted tool.
TEST(FiveAxes, APartThatIsCutTiltedIsNotTurned) {
  Example e = testing::load_example("inclined_contour");
  EXPECT_FALSE(machining::may_turn_the_part(e.job.machine, e.interpretation));
  EXPECT_TRUE(machining::may_turn_the_part(e.job.machine, testing::load_example("slavkovic_square").interpretation));
  // Places at the ends of the reach, where a turn would bring the block within.
  int beside = 0;
  for (const Vec3& to : {Vec3(1, 0, 0), Vec3(-1, 0, 0), Vec3(0, 1, 0), Vec3(0, -1, 0)}) {
    double good = 0, bad = 2;
    const auto fits = [&](double way) {
      Pose at = e.job.X_MW;
      at.p += way * to;
      const auto checked = testing::unwrap(machining::check(e.job.machine, at, e.program, e.interpretation));
      return checked.problems.empty();
    };
    while (bad - good > 2e-3) (fits(0.5 * (good + bad)) ? good : bad) = 0.5 * (good + bad);
    Pose away = e.job.X_MW;
    away.p += bad * to;
    const machining::NearestPlaces found =
        testing::unwrap(machining::nearest_places(e.job.machine, away, e.program, e.interpretation));
    EXPECT_FALSE(found.by_turn) << to.transpose();
    beside += found.by_shift ? 1 : 0;
  }
  EXPECT_GT(beside, 0);
}

// Where C turns with the part, so do A and B: the job that is put elsewhere is the one that is set up there.
TEST(FiveAxes, ATiltedJobThatIsPutElsewhereIsSetUpThere) {
  Example e = testing::load_example("inclined_contour");
  e.job.machine = testing::unwrap(machine::load("kuka-kr210"));
  e.job.X_MW = Pose{Mat3::Identity(), Vec3(1.8, 0, 0.6)};
  EXPECT_TRUE(machining::may_turn_the_part(e.job.machine, e.interpretation));
  const Pose turned{rotation_z(units::from_deg(40)), Vec3(1.7, 0.2, 0.5)};
  Example there = e;
  there.job.X_MW = turned;
  ASSERT_TRUE(set_up(e));
  ASSERT_TRUE(set_up(there));
  ASSERT_TRUE(e.job.tool_frame.tilted);
  machining::put(e.job, turned);
  EXPECT_TRUE(e.job.tool_frame.R_MT.isApprox(there.job.tool_frame.R_MT, 1e-12));
  EXPECT_TRUE(e.job.tool_frame.R_WS.isApprox(there.job.tool_frame.R_WS, 1e-12));
}

// The methods on a ball that turns: the tube's program is that of correct, and A and B of every block are those of the
// place on the programmed path.
TEST(FiveAxes, MethodsAreCompared) {
  Example e = ball(cap(2, 2, 15));
  ASSERT_TRUE(set_up(e));
  const auto all = testing::unwrap(machining::compare_methods(e.job, e.program, e.interpretation));
  ASSERT_EQ(all.size(), 5u);
  EXPECT_NEAR(all[0].distance, testing::predict(e).largest_distance, 10e-6);
  EXPECT_EQ(all[1].text, testing::correct(e).text());
  for (std::size_t k = 1; k < all.size(); ++k) {
    SCOPED_TRACE(machining::name_of(all[k].method));
    EXPECT_LT(all[k].distance, 0.5 * all[0].distance);
    EXPECT_FALSE(all[k].worse);
    const gcode::Program written = testing::unwrap(gcode::parse(all[k].text, "written.ngc"));
    const auto run = testing::unwrap(gcode::interpret(written, e.job.interpret_options()));
    int turned = 0;
    for (const gcode::Move& block : run.moves) {
      if (block.kind == gcode::MoveKind::rapid || !(block.length() > 0)) continue;
      double nearest = 1, off = 1;
      for (const gcode::Move& move : e.interpretation.moves) {
        if (move.kind == gcode::MoveKind::rapid || !move.start_known) continue;
        const double s = move.nearest(block.end), d = (move.point(s) - block.end).norm();
        if (d > nearest + 1e-9) continue;
        const double by = (machining::axes_at(move, s) - block.axes_end).norm();
        off = d < nearest - 1e-9 ? by : std::min(off, by);
        nearest = std::min(nearest, d);
      }
      EXPECT_LT(nearest, 0.6e-3);
      EXPECT_LT(off, units::from_deg(0.15));
      turned += block.axes_end.isZero(1e-6) ? 0 : 1;
    }
    EXPECT_GT(turned, 50);
  }
}

// One orientation over a stock that is no block: what an earlier program has left.
TEST(FiveAxes, AStockThatIsNoBlockIsTaken) {
  const char* const kWay = "G21 G90 S12000 M3\nG0 X-45 Y0 Z10 A20\nG0 Z-1.5\nG1 X45 F1800\nG0 Z10\nM2\n";
  Example block = ball(kWay), left = block;
  left.job.stock.cut_disc({0, 0, -1e-3}, 10e-3);
  ASSERT_TRUE(set_up(block));
  EXPECT_TRUE(block.job.tool_frame.tilted);
  ASSERT_TRUE(set_up(left));
  EXPECT_TRUE(left.job.tool_frame.turns);
  const machining::Prediction a = testing::predict(block), b = testing::predict(left);
  EXPECT_LT(b.pass.removed, 0.8 * a.pass.removed);
  // Both see the same groove where nothing was taken before.
  EXPECT_NEAR(a.deflection.max, b.deflection.max, 0.05 * a.deflection.max);
}

// A move in which the flutes alone meet the block, beside the ball.
TEST(FiveAxes, WhatOnlyTheFlutesCutIsJudged) {
  Example e = ball(
      "G21 G90 S12000 M3\nG0 X-36 Y-40 Z40 A0 B20\nG0 Z-15\nG1 Y40 B21 F1200\nG0 Z40\nG0 X-40 Y0 A0 B0\n"
      "G0 Z-1\nG1 X40 B5 F1200\nG0 Z40\nM2\n");
  ASSERT_TRUE(set_up(e));
  const machining::Prediction p = testing::predict(e);
  ASSERT_EQ(p.moves.size(), 2u);
  EXPECT_EQ(p.moves[0].line, 4);
  EXPECT_GT(p.moves[0].mean_force_size, 10);
  EXPECT_FALSE(p.within(e.job));
}

// Rapids that only turn the tool take the flutes, and the shank, through the block.
TEST(FiveAxes, ARapidThatTurnsOnTheSpotIsACollision) {
  for (const char* turn :
       {"G0 X-40 Y0 A0 B0\nG0 Z-15\nG0 B80\nG0 B0\n", "G0 X-70 Y0 A0 B0\nG0 Z-15\nG0 B75\nG0 B0\n"}) {
    Example e = ball(std::string("G21 G90 S12000 M3\nG0 Z40\n") + turn +
                     "G0 Z40\nG0 X-40 Y12\nG0 Z-1\nG1 X40 B5 F1200\nG0 Z40\nM2\n");
    ASSERT_TRUE(set_up(e));
    const machining::Prediction p = testing::predict(e);
    EXPECT_FALSE(p.within(e.job) && machining::no_rapid_cuts(e.job, e.program, p.pass)) << turn;
    ASSERT_FALSE(p.pass.incidents.empty()) << turn;
    EXPECT_EQ(p.pass.incidents[0].kind, machining::Incident::Kind::rapid_through_stock);
    EXPECT_GT(p.pass.incidents[0].volume, 10e-9) << turn;  // m^3
  }
}

// Neither ball nor flutes meet the block, but what is beyond them does.
TEST(FiveAxes, AShankBeyondTheFlutesIsNamed) {
  Example e = ball("G21 G90 S12000 M3\nG0 Z40\nG0 X-54 Y-40 A0 B65\nG0 Z-15\nG1 Y40 B66 F1200\nG0 Z40\nM2\n");
  ASSERT_TRUE(set_up(e));
  const auto p = machining::predict(e.job, e.program, e.interpretation);
  ASSERT_FALSE(p);
  EXPECT_EQ(p.error().id, "MC215") << p.error().message;
}

// A wall that is higher than the flutes, and the tool leans into it.
TEST(FiveAxes, AShankThatMeetsMaterialIsNamed) {
  Example e = ball("G21 G90 S12000 M3\nG0 X-45 Y0 Z10 B40\nG0 Z-9\nG1 X0 B50 F600\nG0 Z10\nM2\n");
  e.job.cutter.length = 9e-3;
  ASSERT_TRUE(set_up(e));
  const auto p = machining::predict(e.job, e.program, e.interpretation);
  ASSERT_FALSE(p);
  EXPECT_EQ(p.error().id, "MC215");
  EXPECT_EQ(p.error().place.line, 4);
}

}  // namespace
}  // namespace polypod
