// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Each method against a judge of the test's own, and against what SLAV 6 measured.
#include "polypod/machining/compare.hpp"

#include "examples.hpp"
#include "polypod/core/units.hpp"

namespace polypod {
namespace {

using machining::Method;
using machining::MethodOutcome;
using testing::Example;
using testing::load_example;

std::vector<MethodOutcome> compared(const Example& e, const machining::CompareOptions& options = {}) {
  return testing::unwrap(machining::compare_methods(e.job, e.program, e.interpretation, options));
}

const MethodOutcome& of(const std::vector<MethodOutcome>& all, Method method) {
  return *std::find_if(all.begin(), all.end(), [&](const MethodOutcome& m) { return m.method == method; });
}

/// Deflected points of a written program against the lines of the square, by plain geometry: the largest distance of a
/// point that cuts from the contour of the programmed moves, searched point by point.
///
/// At corners the cut changes within the cutter and its width, the command turns away and a plain pass knows of no
/// yielding: they are left out.
constexpr double kCorner = 12e-3;
double largest_distance(const Example& e, const std::string& text) {
  const gcode::Program program = testing::unwrap(gcode::parse(text, "written.ngc"));
  const auto run = testing::unwrap(gcode::interpret(program, e.job.interpret_options()));
  cutting::Stock stock = e.job.stock;
  machining::PassOptions options;
  options.step = 0.5e-3;
  double worst = 0;
  testing::unwrap(machining::run_pass(e.job, program, machining::PassMoves(run.moves), stock, options,
                                      [&](const machining::Sample& s) {
                                        if (!s.cutting) return;
                                        for (const gcode::Move& m : e.interpretation.moves) {
                                          if ((s.command - m.end).norm() < kCorner) return;
                                        }
                                        double nearest = 1;
                                        for (const gcode::Move& m : e.interpretation.moves) {
                                          if (m.kind == gcode::MoveKind::rapid || !m.start_known) continue;
                                          const Vec3 off = s.bent() - m.point(m.nearest(s.bent()));
                                          nearest = std::min(nearest, off.norm());
                                        }
                                        worst = std::max(worst, nearest);
                                      }));
  return worst;
}

/// What the robot is off besides its compliance: a base that is 0.2 mm elsewhere is a shift of the whole part, and a
/// play of joint 1 moves the tip by half of it, to either side. COMET's sequence takes both back; no other method knows
/// them.
TEST(Compare, CometTakesBackWhatTheRobotIsOffBesides) {
  Example e = load_example("slavkovic_square");
  const std::vector<MethodOutcome> plain = compared(e);
  for (const MethodOutcome& m : plain) EXPECT_FALSE(m.with_robot_errors);
  auto moved = std::get<machine::SerialArm>(e.job.machine);
  moved.X_MB.p += Vec3(0, 0, 0.2e-3);  // along the tool: nothing that cuts differs
  e.job.robot_errors.signature = std::make_shared<const machine::AnyMachine>(moved);
  const std::vector<MethodOutcome> shifted = compared(e);
  for (const Method method : {Method::none, Method::tube, Method::mirror, Method::abele}) {
    const MethodOutcome& m = of(shifted, method);
    EXPECT_NEAR(m.distance, of(plain, method).distance, 1e-9);
    EXPECT_GT(*m.with_robot_errors, 0.19e-3) << name_of(method);
    EXPECT_LT(*m.with_robot_errors, m.distance + 0.2e-3 + 1e-6) << name_of(method);
    EXPECT_FALSE(m.inside);
  }
  // But for the chips, which its command 0.2 mm deeper would take.
  EXPECT_LT(*of(shifted, Method::comet).with_robot_errors, of(plain, Method::comet).distance + 25e-6);
  EXPECT_TRUE(of(shifted, Method::tube).distance < e.job.tolerance);

  e.job.robot_errors = {};
  e.job.robot_errors.backlash.assign(5, 0);
  e.job.robot_errors.backlash[0] = 0.4e-3 / 1.4;  // about 0.2 mm to either side at 1.4 m
  const std::vector<MethodOutcome> played = compared(e);
  EXPECT_GT(*of(played, Method::none).with_robot_errors, of(plain, Method::none).distance + 0.1e-3);
  EXPECT_GT(*of(played, Method::tube).with_robot_errors, 0.15e-3);
  EXPECT_LT(*of(played, Method::comet).with_robot_errors, 0.3 * *of(played, Method::none).with_robot_errors);

  // Friction does what a play of twice the wind-up does.
  const std::vector<MethodOutcome> by_play = [&] {
    e.job.robot_errors.backlash[0] = 2 * 100 * moved.dh[0].compliance;
    return compared(e);
  }();
  e.job.robot_errors = {};
  e.job.robot_errors.friction.assign(5, 0);
  e.job.robot_errors.friction[0] = 100;
  EXPECT_NEAR(*of(compared(e), Method::none).with_robot_errors, *of(by_play, Method::none).with_robot_errors, 1e-9);

  // A joint without a compliance winds up by nobody knows how much.
  std::get<machine::SerialArm>(e.job.machine).dh[0].compliance = 0;
  const std::vector<MethodOutcome> unknown = compared(e);
  for (const MethodOutcome& m : unknown) EXPECT_FALSE(m.judged) << name_of(m.method);
  EXPECT_NE(unknown.front().notes.back().find("friction of joint 1 is not counted"), std::string::npos);
}

TEST(Compare, SquareOfSlavkovic) {
  const Example e = load_example("slavkovic_square");
  const std::vector<MethodOutcome> all = compared(e);
  ASSERT_EQ(all.size(), 5u);
  const MethodOutcome &none = of(all, Method::none), &tube = of(all, Method::tube), &mirror = of(all, Method::mirror),
                      &comet = of(all, Method::comet), &abele = of(all, Method::abele);
  EXPECT_NEAR(none.normal.max, 273e-6, 40e-6);
  EXPECT_GT(none.normal.mean, 180e-6);
  EXPECT_LT(tube.normal.max, 100e-6);
  EXPECT_TRUE(tube.inside);
  EXPECT_FALSE(none.inside);
  for (const MethodOutcome* m : {&mirror, &comet, &abele}) EXPECT_LT(std::abs(m->normal.mean), 0.2 * none.normal.mean);
  // What couples force and deflection leaves less than what takes the force at the programmed path.
  EXPECT_LT(std::abs(abele.normal.mean), std::abs(comet.normal.mean) + 1e-6);
  // The tube needs the fewest lines of those that correct; dense paths need a block every half millimetre.
  EXPECT_LT(tube.lines, mirror.lines);
  EXPECT_LT(mirror.lines, comet.lines);
  EXPECT_GT(comet.lines, 1500u);
}

TEST(Compare, JudgedAsAPlainPassDoes) {
  const Example e = load_example("slavkovic_square");
  for (const MethodOutcome& m : compared(e)) {
    // A joint of the tube's correction is yielding, which a reader of the text does not know of.
    if (m.method == Method::tube) continue;
    // The plain search lets a corner count for either move, the judge for its own alone.
    EXPECT_LE(largest_distance(e, m.text), m.distance + 5e-6) << machining::name_of(m.method);
    EXPECT_GE(largest_distance(e, m.text), 0.5 * std::abs(m.normal.max)) << machining::name_of(m.method);
  }
}

TEST(Compare, MirrorIsThatOfCorrect) {
  const Example e = load_example("slavkovic_square");
  machining::CompareOptions options;
  options.mirror_points = 4;
  const MethodOutcome mirror = of(compared(e, options), Method::mirror);
  machining::CorrectOptions correct_options;
  correct_options.method = machining::CorrectMethod::mirror;
  correct_options.mirror_points = 4;
  const machining::Correction c = testing::correct(e, correct_options);
  EXPECT_EQ(mirror.text, c.text());
  EXPECT_DOUBLE_EQ(mirror.normal.max, c.after.normal.max);
  EXPECT_EQ(mirror.lines, c.lines_out);
}

TEST(Compare, AbelesRoundsContract) {
  const Example e = load_example("slavkovic_square");
  machining::CompareOptions one, many;
  one.abele_rounds = 1;
  many.abele_rounds = 6;
  const MethodOutcome first = of(compared(e, one), Method::abele), last = of(compared(e, many), Method::abele);
  EXPECT_LE(std::abs(last.normal.mean), std::abs(first.normal.mean) + 0.2e-6);
  EXPECT_LT(std::abs(last.normal.mean), 3e-6);
}

TEST(Compare, ProgramsThatDoNotFitAreRefused) {
  Example e = load_example("slavkovic_square");
  e.job.X_MW.p.y() = -3;
  const auto r = machining::compare_methods(e.job, e.program, e.interpretation);
  ASSERT_FALSE(r);
  EXPECT_EQ(r.error().id, "MC210");
}

}  // namespace
}  // namespace polypod
