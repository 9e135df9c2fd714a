// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The written G-code is read by the reader of all other commands and sent through the machine: tip and axis are those
// of the CL file.
#include <gmock/gmock.h>

#include <fmt/format.h>

#include <cmath>
#include <random>

#include "parts.hpp"
#include "paths.hpp"
#include "polypod/gcode/interpreter.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/machining/check.hpp"

namespace polypod {
namespace {

using post::Dialect;
using test::Case;
using test::cases;
using test::Posted;
using test::value;

constexpr double kDigits =
    1e-6;  // mm and deg are printed with 6 decimals: half a digit of each, and the inverse's rounding

gcode::Interpretation run(const Posted& posted) {
  const auto program = value(gcode::parse(posted.written.text, "out.ngc"));
  return value(gcode::interpret(program));
}

Vec3 axis_of(const Vec3& abc) {
  return rotation_abc(abc.x(), abc.y(), abc.z()).col(2);
}

/// Every end of a step of the CL file, in order, is an end of a move of the program with the same tip and axis, and the
/// forward kinematics of its joints has them, too.
void expect_same_path(const Posted& posted, const Vec3& origin) {
  const gcode::Interpretation program = run(posted);
  std::size_t at = 0;
  machine::JointVector q;
  for (const post::Step& step : posted.path.steps) {
    if (!step.moves()) continue;
    const auto fits = [&](const gcode::Move& m) {
      return (m.end - step.tip).norm() < 1e-3 * kDigits && angle_between(axis_of(m.axes_end), step.axis) < kDigits;
    };
    while (at < program.moves.size() && !fits(program.moves[at])) ++at;
    ASSERT_LT(at, program.moves.size()) << "line " << step.line << " of the CL file is not reached";
    const Vec3 abc = program.moves[at].axes_end;
    const Pose X{rotation_abc(abc.x(), abc.y(), abc.z()), origin + program.moves[at].end};
    const auto& machine = posted.configuration.machine;
    const auto inverse = q.size() > 0 ? kinematics::inverse_near(machine, X, q) : kinematics::inverse(machine, X);
    ASSERT_NE(inverse.reachable(), nullptr) << "line " << step.line;
    q = inverse.reachable()->joints;
    const Pose tool = kinematics::forward(machine, q).poses.front();
    EXPECT_LT((tool.p - origin - step.tip).norm(), 1e-6) << "line " << step.line;
    EXPECT_LT(angle_between(tool.R.col(2), step.axis), 1e-6) << "line " << step.line;
  }
}

/// Between the points the tip stays on the straight lines of the CL file and the axis within its tolerance of the
/// shortest way, judged on the program's own moves.
void expect_within_tolerance(const Posted& posted, double axis_tolerance) {
  const gcode::Interpretation program = run(posted);
  std::vector<const post::Step*> steps;
  for (const post::Step& s : posted.path.steps)
    if (s.moves()) steps.push_back(&s);
  std::size_t next = 1;
  for (const gcode::Move& m : program.moves) {
    if (!m.start_known || m.kind == gcode::MoveKind::arc) continue;
    while (next < steps.size()) {
      const post::Step &a = *steps[next - 1], &b = *steps[next];
      const double length = (b.tip - a.tip).norm(), s = length > 0 ? (m.end - a.tip).norm() / length : 1;
      if (b.kind != post::StepKind::arc && (a.tip + s * (b.tip - a.tip) - m.end).norm() < 2e-9 && s < 1 + 1e-6) break;
      ++next;
    }
    ASSERT_LT(next, steps.size());
    const post::Step &a = *steps[next - 1], &b = *steps[next];
    const double length = (b.tip - a.tip).norm();
    if (length < 1e-6) continue;
    for (const double f : {0.2, 0.5, 0.8}) {
      const Vec3 p = m.start + f * (m.end - m.start);
      const double s = (p - a.tip).norm() / length, angle = angle_between(a.axis, b.axis);
      const Vec3 n = a.axis.cross(b.axis);
      const Vec3 k = n.norm() < 1e-12 ? a.axis : Vec3(Eigen::AngleAxisd(s * angle, n.normalized()) * a.axis);
      // 2 %: the tolerance is kept at three points of each move, these are others.
      EXPECT_LT(angle_between(axis_of(m.axes_start + f * (m.axes_end - m.axes_start)), k),
                1.02 * axis_tolerance + 1e-7);
    }
    if ((m.end - b.tip).norm() < 2e-9) ++next;
  }
}

TEST(Post, EveryConfigurationFollowsTheExample) {
  const post::Path path = value(post::read_path(test::example("part.cl")));
  for (const Case& c : cases()) {
    SCOPED_TRACE(std::string(c.machine) + " " + c.config);
    const Posted posted = test::post_to(Dialect::ngc, test::machine_of(c), c.config, path, c.origin_mm);
    for (const auto& p : posted.plan.problems) ADD_FAILURE() << p.line << " " << p.kind << " " << p.detail;
    EXPECT_EQ(posted.configuration.name, c.config);
    expect_same_path(posted, c.origin_mm * 1e-3);
    expect_within_tolerance(posted, units::from_deg(0.1));
    const gcode::Program program = value(gcode::parse(posted.written.text, "out.ngc"));
    const auto checked = value(
        machining::check(posted.configuration.machine, {Mat3::Identity(), c.origin_mm * 1e-3}, program, run(posted)));
    for (const auto& p : checked.problems) ADD_FAILURE() << "check: " << p.line << " " << p.kind << " " << p.detail;
    EXPECT_NEAR(checked.time, posted.plan.time, 0.02 * checked.time);
  }
}

/// The two arcs of the ring are G3 of G17; in another plane they are chords.
TEST(Post, ArcsAreArcsWhereTheControllerHasThem) {
  const std::string head = "UNITS/MM\nRAPID\nGOTO/20,0,0\nFEDRAT/600\n";
  const auto arc = [&](const std::string& text) {
    return test::post_to(Dialect::ngc, test::load("lola50"), "auto", value(post::parse_cl(head + text + "FINI\n", "t")),
                         {0, -1300, 0});
  };
  const Posted flat = arc("CIRCLE/0,0,0,0,0,-1,20\nGOTO/0,20,-1\n");
  EXPECT_THAT(flat.written.text, ::testing::HasSubstr("G2 X0 Y20 Z-1 I-20 J0 F600"));
  const Posted upright = arc("CIRCLE/0,0,0,0,-1,0,20\nGOTO/0,0,20\n");  // clockwise seen from +Y
  EXPECT_THAT(upright.written.text, ::testing::HasSubstr("G18\nG2 X0 Z20 I-20 K0 F600"));
  const Posted oblique = arc("CIRCLE/0,0,0,0,0.6,0.8,20\nGOTO/-20,0,0\n");
  EXPECT_EQ(oblique.written.text.find("G2 "), std::string::npos);
  EXPECT_GT(oblique.plan.inserted, 30);
  EXPECT_LE(oblique.plan.chord_error, 1e-5);
  const gcode::Interpretation program = run(oblique);
  for (const gcode::Move& m : program.moves) {
    if (m.kind != gcode::MoveKind::line) continue;
    const Vec3 middle = (m.start + m.end) / 2;
    EXPECT_NEAR(middle.norm(), 0.020, 1.05e-5);
    EXPECT_NEAR(m.end.norm(), 0.020, 2e-9);
  }
}

TEST(Post, FeedsPerMinuteAndInverseTimeTakeTheSameTime) {
  const post::Path path = value(post::parse_cl(
      "UNITS/MM\nRAPID\nGOTO/0,0,0,0,0,1\nFEDRAT/600\nGOTO/30,40,0,0.1736482,0,0.9848078\nGOTO/30,40,0,0,0,1\nFINI\n",
      "t"));
  post::WriteOptions inverse;
  inverse.inverse_time = true;
  const Posted a = test::post_to(Dialect::ngc, test::load("lola50"), "auto", path, {0, -1300, 0});
  const Posted b = test::post_to(Dialect::ngc, test::load("lola50"), "auto", path, {0, -1300, 0}, {}, inverse);
  EXPECT_THAT(b.written.text, ::testing::HasSubstr("G93\n"));
  const auto seconds = [&](const Posted& posted) {
    double sum = 0;
    for (const gcode::Move& m : run(posted).moves)
      if (m.kind == gcode::MoveKind::line && m.length() > 1e-9) sum += m.length() / m.feed;
    return sum;
  };
  EXPECT_NEAR(seconds(a), 5, 1e-6);
  EXPECT_NEAR(seconds(b), 5, 1e-3);
  EXPECT_THAT(a.written.text, ::testing::HasSubstr("F1800")) << "a turn without a way is fed in deg/min";
  EXPECT_NEAR(a.plan.time, 5 + 10.0 / 30, 1e-3);
}

/// Through the pole of A and C the tool goes on with the other sign of A, and C does not turn.
/// Nothing says where the first cut of a CL file without FROM and RAPID starts: it has its own feed, and no time.
TEST(Post, AFirstCutHasItsFeed) {
  const post::Path path = value(post::parse_cl("UNITS/MM\nFEDRAT/100\nGOTO/0,0,50,0,0,1\nGOTO/10,0,50\nFINI\n", "t"));
  const Posted plain = test::post_to(Dialect::ngc, test::load("lola50"), "auto", path, {0, -1300, 0});
  EXPECT_THAT(plain.written.text, ::testing::HasSubstr("G1 X0 Y0 Z50 A0 B0 F100\nX10\n"));
  post::WriteOptions options;
  options.inverse_time = true;
  const Posted inverse = test::post_to(Dialect::ngc, test::load("lola50"), "auto", path, {0, -1300, 0}, {}, options);
  EXPECT_THAT(inverse.written.text, ::testing::HasSubstr("G94 G1 X0 Y0 Z50 A0 B0 F100\nG93\nX10 F10\n"));
}

TEST(Post, GoesThroughThePole) {
  const post::Path path = value(post::parse_cl(
      "UNITS/MM\nRAPID\nGOTO/-20,0,0,-0.17364818,0,0.98480775\nFEDRAT/600\nGOTO/20,0,0,0.17364818,0,0.98480775\nFINI\n",
      "t"));
  const Posted posted =
      test::post_to(Dialect::ngc, test::load(test::example("lola50_six.toml")), "vertical-ac", path, {0, -1300, 0});
  EXPECT_TRUE(posted.plan.ok());
  ASSERT_EQ(posted.plan.moves.size(), 2u);
  EXPECT_NEAR(posted.plan.moves[1].angles.z(), posted.plan.moves[0].angles.z(), 1e-12);
  EXPECT_NEAR(posted.plan.moves[1].angles.x(), -posted.plan.moves[0].angles.x(), 1e-12);
  // Beside the pole by 1 deg C must swing round: points are inserted until the axis stays within its tolerance.
  const post::Path beside =
      value(post::parse_cl("UNITS/MM\nRAPID\nGOTO/-20,0,0,-0.17364818,0.0175,0.98465\nFEDRAT/600\nGOTO/"
                           "20,0,0,0.17364818,0.0175,0.98465\nFINI\n",
                           "t"));
  const Posted swung =
      test::post_to(Dialect::ngc, test::load(test::example("lola50_six.toml")), "vertical-ac", beside, {0, -1300, 0});
  EXPECT_GT(swung.plan.inserted, 10);
  EXPECT_LE(swung.plan.axis_error, units::from_deg(0.1));
  expect_within_tolerance(swung, units::from_deg(0.1));
}

/// At the pole the program begins with the C that it needs next.
TEST(Post, BeginsAtThePoleWithTheCThatComes) {
  const post::Path path = value(post::parse_cl(
      "UNITS/MM\nRAPID\nGOTO/0,0,0,0,0,1\nFEDRAT/600\nGOTO/20,0,0,0.17364818,0,0.98480775\nFINI\n", "t"));
  const Posted posted =
      test::post_to(Dialect::ngc, test::load(test::example("lola50_six.toml")), "vertical-ac", path, {0, -1300, 0});
  ASSERT_EQ(posted.plan.moves.size(), 2u);
  EXPECT_NEAR(posted.plan.moves[0].angles.z(), std::numbers::pi / 2, 1e-12);
}

/// Round a cone C turns on past 180 deg instead of back.
TEST(Post, RotaryAxesTurnOn) {
  std::string text = "UNITS/MM\nFEDRAT/600\nRAPID\n";
  for (int i = 0; i <= 16; ++i) {
    const double a = 2 * std::numbers::pi * i / 16;
    text += fmt::format("GOTO/{:.6f},{:.6f},0,{:.8f},{:.8f},{:.8f}\n", 20 * std::cos(a), 20 * std::sin(a),
                        0.2 * std::cos(a), 0.2 * std::sin(a), std::sqrt(0.96));
  }
  const Posted posted = test::post_to(Dialect::ngc, test::load(test::example("lola50_six.toml")), "vertical-ac",
                                      value(post::parse_cl(text + "FINI\n", "t")), {0, -1300, 0});
  EXPECT_TRUE(posted.plan.ok()) << posted.plan.problems.front().detail;
  EXPECT_NEAR(std::abs(posted.plan.moves.back().angles.z() - posted.plan.moves.front().angles.z()),
              2 * std::numbers::pi, 1e-9);
  for (std::size_t i = 1; i < posted.plan.moves.size(); ++i) {
    EXPECT_LT((posted.plan.moves[i].angles - posted.plan.moves[i - 1].angles).cwiseAbs().maxCoeff(), 0.5);
  }
  EXPECT_LE(posted.plan.axis_error, units::from_deg(0.1));
}

/// Round after round in one sense joint 6 comes to the end of its range.
TEST(Post, NamesWhereAnAxisMustBeRewound) {
  std::string text = "UNITS/MM\nFEDRAT/600\nRAPID\n";
  for (int i = 0; i <= 48; ++i) {
    const double a = 2 * std::numbers::pi * i / 16;
    text += fmt::format("GOTO/{:.6f},{:.6f},0,{:.8f},{:.8f},{:.8f}\n", 20 * std::cos(a), 20 * std::sin(a),
                        0.2 * std::cos(a), 0.2 * std::sin(a), std::sqrt(0.96));
  }
  const Posted posted = test::post_to(Dialect::ngc, test::load(test::example("lola50_six.toml")), "vertical-ac",
                                      value(post::parse_cl(text + "FINI\n", "t")), {0, -1300, 0});
  ASSERT_FALSE(posted.plan.ok());
  EXPECT_EQ(posted.plan.problems.front().kind, "rewind");
  EXPECT_THAT(posted.plan.problems.front().detail, ::testing::HasSubstr("joint 6"));
}

TEST(Post, NamesWhatTheMachineCannotDo) {
  const auto kinds = [](const machine::AnyMachine& machine, const std::string& gotos) {
    const Posted posted =
        test::post_to(Dialect::ngc, machine, "auto",
                      value(post::parse_cl("UNITS/MM\nFEDRAT/600\nRAPID\n" + gotos + "FINI\n", "t")), {0, -1300, 0});
    std::vector<std::pair<int, std::string>> out;
    for (const auto& p : posted.plan.problems) out.emplace_back(p.line, p.kind);
    return out;
  };
  using ::testing::Contains;
  using ::testing::Pair;
  EXPECT_THAT(kinds(test::load("lola50"), "GOTO/0,0,0\nGOTO/0,-1200,0\n"), Contains(Pair(5, "reach")));
  EXPECT_THAT(kinds(test::load("lola50"), "GOTO/0,0,0\nGOTO/0,0,0,0,0.9961947,0.0871557\n"),
              Contains(Pair(5, "limit")));
  EXPECT_THAT(kinds(test::load("delta-brno"), "GOTO/0,1300,500\nGOTO/0,1300,500,0.6,0,0.8\n"),
              Contains(Pair(5, "axis")));
  EXPECT_EQ(kinds(test::load("lola50"), "GOTO/0,0,0\nGOTO/0,50,0\n").size(), 0u);
}

TEST(Post, ConfigurationsThatAMachineDoesNotHave) {
  EXPECT_EQ(test::id_of(post::configure(test::load("lola50"), "horizontal-ab")), "PO120");
  EXPECT_EQ(test::id_of(post::configure(test::load("lola50"), "vertical-ac")), "PO120");
  EXPECT_EQ(test::id_of(post::configure(test::load("lola50"), "six")), "PO120");
  EXPECT_EQ(test::id_of(post::configure(test::load("hexapod-strut"), "vertical-ab")), "PO120");
  EXPECT_EQ(test::id_of(post::configure(test::load("lola50"), "upside-down")), "PO120");
  EXPECT_EQ(test::id_of(post::configure(test::load("planar-3rrr"), "auto")), "PO121");
  const post::Path path = value(post::parse_cl("UNITS/MM\nRAPID\nGOTO/0,0,0\nFINI\n", "t"));
  post::PlanOptions options;
  options.origin = {0, -1.3, 0};
  options.branch = "sideways";
  EXPECT_EQ(test::id_of(post::plan(value(post::configure(test::load("lola50"), "auto")), path, options)), "PO122");
  options.branch.clear();
  options.progress = [](double) { return false; };
  EXPECT_EQ(test::id_of(post::plan(value(post::configure(test::load("lola50"), "auto")), path, options)), "PO199");
}

/// With C = 0 joint 6 leaves its range; C chosen along the program keeps it there.
TEST(Post, ChoosesCWhereAConstantOneDoesNotDo) {
  const machine::AnyMachine machine =
      test::load(test::example("lola50_six.toml"), {{"limits[6].min_deg", "20"}, {"limits[6].max_deg", "60"}});
  const post::Path path = value(post::read_path(test::example("part.cl")));
  post::PlanOptions constant;
  EXPECT_FALSE(test::post_to(Dialect::ngc, machine, "six", path, {0, -1300, 0}, constant).plan.ok());
  post::PlanOptions free;
  free.c.reset();
  const Posted chosen = test::post_to(Dialect::ngc, machine, "six", path, {0, -1300, 0}, free);
  for (const auto& p : chosen.plan.problems) ADD_FAILURE() << p.line << " " << p.kind << " " << p.detail;
  expect_same_path(chosen, {0, -1.3, 0});
}

/// A program posted to G-code makes the same moves.
TEST(Post, AProgramStaysWhatItIs) {
  const std::string file = test::source("examples/slavkovic_groove/program.ngc");
  const auto program = value(gcode::read(file));
  const auto before = value(gcode::interpret(program));
  const Posted posted =
      test::post_to(Dialect::ngc, test::load("lola50"), "auto", value(post::read_path(file)), {0, -1300, 0});
  const auto after = run(posted);
  std::size_t at = 0;
  for (const gcode::Move& m : before.moves) {
    while (at < after.moves.size() && ((after.moves[at].end - m.end).norm() > 1e-9 || after.moves[at].kind != m.kind))
      ++at;
    ASSERT_LT(at, after.moves.size());
    if (m.kind != gcode::MoveKind::rapid) {
      EXPECT_NEAR(after.moves[at].feed, m.feed, 1e-9);
    }
    EXPECT_EQ(after.moves[at].tool, m.tool);
    EXPECT_EQ(after.moves[at].spindle, m.spindle);
  }
}

/// Random CL files, in every configuration.
TEST(Post, RandomPathsAreFollowed) {
  std::mt19937 random(20260523);
  std::uniform_real_distribution<double> place(-120, 120), tilt(0, 20), turn(0, 360);
  for (int trial = 0; trial < 12; ++trial) {
    std::string text = "UNITS/MM\nFEDRAT/1200,MMPM\nRAPID\n";
    for (int i = 0; i < 8; ++i) {
      const double t = units::from_deg(tilt(random)), a = units::from_deg(turn(random));
      text += fmt::format("GOTO/{:.5f},{:.5f},{:.5f},{:.9f},{:.9f},{:.9f}\n", place(random), place(random),
                          place(random) / 2, std::sin(t) * std::cos(a), std::sin(t) * std::sin(a), std::cos(t));
    }
    const post::Path path = value(post::parse_cl(text + "FINI\n", "random.cl"));
    for (const Case& c : cases()) {
      SCOPED_TRACE(fmt::format("trial {} {} {}\n{}", trial, c.machine, c.config, text));
      const Posted posted = test::post_to(Dialect::ngc, test::machine_of(c), c.config, path, c.origin_mm);
      for (const auto& p : posted.plan.problems) ADD_FAILURE() << p.line << " " << p.kind << " " << p.detail;
      expect_same_path(posted, c.origin_mm * 1e-3);
      expect_within_tolerance(posted, units::from_deg(0.1));
    }
  }
}

}  // namespace
}  // namespace polypod
