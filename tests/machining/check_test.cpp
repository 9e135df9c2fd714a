// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/check.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include "machines.hpp"
#include "machining/examples.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/machining/accept.hpp"
#include "polypod/machining/beginning.hpp"

namespace polypod {
namespace {

machining::CheckResult check(const testing::Example& e, const Vec3& origin_mm) {
  return testing::unwrap(
      machining::check(e.job.machine, Pose{Mat3::Identity(), 1e-3 * origin_mm}, e.program, e.interpretation));
}

TEST(Check, SquareFitsInTheMiddle) {
  const auto e = testing::load_example("slavkovic_square");
  const auto r = check(e, Vec3(0, -1300, 0));
  EXPECT_TRUE(r.ok);
  // Closed form: the way in and four sides, at 1600 mm/min, the plunge of 4 mm at 400, rapids of 8 and 12 mm.
  EXPECT_NEAR(units::to_mm(r.length), 260 + 250 + 250 + 260 + 4 + 8 + 12, 1e-9);
  EXPECT_NEAR(r.time, 1020 / 1600.0 * 60 + 4 / 400.0 * 60 + 20 / 100.0, 1e-9);
  ASSERT_EQ(r.joints.size(), 5u);
  EXPECT_NEAR(r.joints[0].max, std::atan2(0.125, 1.175), 1e-3);  // joint 1 points at the tool, A = B = 0
  EXPECT_NEAR(r.joints[3].max, 0, 1e-12);                        // the vertical tool lies in the arm's plane
}

TEST(Check, OutOfLimitsNamesLinesAndJoints) {
  const auto e = testing::load_example("slavkovic_square");
  const auto r = check(e, Vec3(0, -1850, 0));
  EXPECT_FALSE(r.ok);
  ASSERT_FALSE(r.problems.empty());
  for (const auto& p : r.problems) EXPECT_GE(p.line, 9);
}

TEST(Check, TiltedToolGoesThroughTheInverse) {
  const auto e = testing::with_program("slavkovic_square", "G21 G90 G94\nG0 X0 Y0 Z0 A0 B0\nG1 A20 B-15 F1000\nM2\n");
  const auto r = check(e, Vec3(0, -1300, 0));
  EXPECT_TRUE(r.ok);
  EXPECT_GT(r.joints[4].max - r.joints[4].min, units::from_deg(10));
}

TEST(Check, AMoveFromAnUnknownPlaceIsNamedAndNotCounted) {
  const auto e = testing::with_program("slavkovic_square", "G21 G90 G94\nG1 X10 Y10 Z5 F600\nG1 X20\nM2\n");
  const auto r = check(e, Vec3(0, -1300, 0));
  EXPECT_TRUE(r.ok);
  EXPECT_NEAR(units::to_mm(r.length), 10, 1e-9);
  EXPECT_NEAR(r.time, 10 / 600.0 * 60, 1e-9);
  ASSERT_EQ(r.not_judged.size(), 1u);
  EXPECT_EQ(r.not_judged[0].line, 2);
  EXPECT_EQ(r.not_judged[0].kind, "way");
  EXPECT_EQ(r.not_judged[0].detail, "X, Y and Z are not known where it starts");
}

/// The speeds of joints in a cut against J^-1 of the tool's speed, at 2000 points of a line.
TEST(Check, JointSpeedsAreThoseOfTheJacobian) {
  const auto e = testing::with_program("slavkovic_square", "G21 G90 G94\nG0 X-100 Y-50 Z0\nG1 X100 Y60 F60000\nM2\n");
  const Vec3 origin(0, -1.3, 0), from(-0.1, -0.05, 0), to(0.1, 0.06, 0);
  Vec6 twist = Vec6::Zero();
  twist.head<3>() = (to - from).normalized();  // 1 m/s
  double most = 0;
  for (int i = 0; i <= 2000; ++i) {
    const Pose X{Mat3::Identity(), origin + from + i / 2000.0 * (to - from)};
    const auto q = kinematics::inverse(e.job.machine, X).reachable()->joints;
    const Eigen::VectorXd speeds =
        kinematics::jacobian(e.job.machine, X, q).leftCols(5).colPivHouseholderQr().solve(twist);
    most = std::max(most, speeds.cwiseAbs().maxCoeff());
  }
  machining::CheckOptions options;
  const auto checked = [&](double limit) {
    options.limits.joint_speeds.assign(5, limit);
    return testing::unwrap(
        machining::check(e.job.machine, Pose{Mat3::Identity(), origin}, e.program, e.interpretation, options));
  };
  const auto slow = checked(0.5 * most);
  EXPECT_NEAR(slow.fastest.share, 2, 0.01);
  EXPECT_EQ(slow.fastest_line, 3);
  ASSERT_EQ(slow.problems.size(), 1U);
  EXPECT_EQ(slow.problems[0].kind, "speed");
  EXPECT_EQ(slow.problems[0].line, 3);
  EXPECT_THAT(slow.problems[0].detail, ::testing::HasSubstr("would go at"));
  EXPECT_FALSE(checked(0.99 * most).ok);
  EXPECT_TRUE(checked(1.01 * most).ok);
  EXPECT_EQ(check(e, Vec3(0, -1300, 0)).fastest_line, 0) << "no limits, nothing judged";
  // A turn alone takes F as degrees a minute, in inches, too; against differences of the inverse. With inverse time
  // nothing says how long it takes.
  const auto at = [&](double a_deg) {
    const Pose X{rotation_abc(units::from_deg(a_deg), 0, 0), origin};
    return kinematics::inverse(e.job.machine, X).reachable()->joints;
  };
  double turning = 0;  // rad/s
  for (double a = 0; a < 20; a += 0.05)
    turning = std::max(turning, (at(a + 0.05) - at(a)).cwiseAbs().maxCoeff() / (0.05 / (9000.0 / 60)));
  const auto turned = [&](const std::string& text) {
    const auto turn = testing::with_program("slavkovic_square", "G21 G90 G94\nG0 X0 Y0 Z0 A0 B0\n" + text + "M2\n");
    options.limits.joint_speeds.assign(5, turning);
    return testing::unwrap(
        machining::check(turn.job.machine, Pose{Mat3::Identity(), origin}, turn.program, turn.interpretation, options));
  };
  for (const char* text : {"G1 A20 F9000\n", "G20\nG1 A20 F9000\n"}) {
    const auto r = turned(text);
    EXPECT_GE(r.fastest_line, 3);
    EXPECT_NEAR(r.fastest.share, 1, 0.01);
    EXPECT_NEAR(r.time, 20.0 / 9000 * 60, 1e-9);
  }
  const auto untimed = turned("G93 G1 A20 F10\n");
  EXPECT_EQ(untimed.fastest_line, 0);
  EXPECT_THAT(untimed.notes, ::testing::Contains(::testing::HasSubstr("no cut was there")));
  ASSERT_EQ(untimed.not_judged.size(), 2u);
  EXPECT_EQ(untimed.not_judged[1].kind, "time");
}

/// A line that passes 1 mm beside the poses at which joint 5 of a spherical wrist is straight: joint 4 turns by some 50
/// deg within the millimetre there, but does not jump. Where its speed is judged, that is what counts.
TEST(Check, AJointThatHurriesDoesNotJump) {
  auto e = testing::load_example("slavkovic_square");
  e.job.machine = *machine::load("kuka-kr210");
  machine::JointVector straight(6);
  straight << 0, units::from_deg(-100), units::from_deg(110), 0, 0, 0;
  const Pose X_0 = kinematics::forward(e.job.machine, straight).poses.front();
  const Vec3 abc = angles_abc(X_0.R) * 180 / std::numbers::pi, p = X_0.p + Vec3(0, 1e-3, 0);
  const auto program = [&](const char* feed) {
    const std::string at = fmt::format("G0 X{:.9f} Y{:.9f} Z{:.9f} A{:.9f} B{:.9f} C{:.9f}\n", 1e3 * p.x(), 1e3 * p.y(),
                                       1e3 * p.z() - 10, abc.x(), abc.y(), abc.z());
    return testing::with_program("slavkovic_square",
                                 "G21 G90 G94\n" + at + fmt::format("G1 Z{:.9f} {}\nM2\n", 1e3 * p.z() + 10, feed));
  };
  // Followed in steps of 2 um.
  double most = 0;
  machine::JointVector last;
  for (int i = -5000; i <= 5000; ++i) {
    const Pose X{X_0.R, p + Vec3(0, 0, 2e-6 * i)};
    const auto all =
        last.size() > 0 ? kinematics::inverse_near(e.job.machine, X, last) : kinematics::inverse(e.job.machine, X);
    const machine::JointVector q = all.reachable()->joints;
    if (last.size() > 0) most = std::max(most, (q - last).cwiseAbs().maxCoeff() / 2e-6);  // rad/m
    last = q;
  }
  ASSERT_GT(most, 500);
  machining::CheckOptions options;
  const auto checked = [&](const char* feed, double limit) {
    const auto with = program(feed);
    options.limits.joint_speeds.assign(limit > 0 ? 6 : 0, limit);
    return testing::unwrap(machining::check(e.job.machine, Pose(), with.program, with.interpretation, options));
  };
  const double fast = most * 0.02;  // rad/s at F1200
  const auto r = checked("F1200", fast / 2);
  EXPECT_NEAR(r.fastest.share, 2, 0.02);
  ASSERT_EQ(r.problems.size(), 1u);
  EXPECT_EQ(r.problems[0].kind, "speed");
  EXPECT_FALSE(checked("F1200", 0.98 * fast).ok);
  EXPECT_TRUE(checked("F1200", 1.02 * fast).ok);
  // Without limits nothing judges it, and it is named.
  const auto unjudged = checked("F1200", 0);
  ASSERT_EQ(unjudged.problems.size(), 1u);
  EXPECT_EQ(unjudged.problems[0].kind, "branch");
  EXPECT_THAT(unjudged.problems[0].detail, ::testing::HasSubstr("joint_speeds"));
  // What may be predicted and corrected goes with it.
  auto with = program("F1200");
  with.job.machine = e.job.machine;
  with.job.X_MW = Pose();
  const auto accepted = [&] { return machining::accept_reach(with.job, with.program, with.interpretation, {}); };
  ASSERT_FALSE(accepted().has_value());
  EXPECT_EQ(accepted().error().id, "MC210");
  with.job.joint_speeds.assign(6, fast / 2);
  EXPECT_TRUE(accepted().has_value()) << "speeds are the answer of check";
}

/// Beside a straight wrist a millimetre asks for six degrees of a joint and more: named where no speeds are judged. A
/// line that leads through it, the joints following, is judged by these where they are known.
TEST(Check, PosesNearAStraightWristAreNamedWhereNobodyJudgesSpeeds) {
  const machine::AnyMachine m = test::load(
      "kuka-kr210", {{"tool.x_mm", "300"}, {"tool.z_mm", "150"}, {"tool.a_deg", "0"}, {"tool.b_deg", "-90"}});
  const machine::JointVector q =
      (machine::JointVector(6) << 0, units::from_deg(-60), units::from_deg(60), 0, 0, 0).finished();
  const Pose X_MW{Mat3::Identity(), kinematics::forward(m, q).poses.front().p};
  const auto checked = [&](const char* text, double limit, int unknown_of = -1) {
    const auto e = testing::with_program("slavkovic_square", std::string("G21 G90 G94\n") + text + "M2\n");
    machining::CheckOptions options;
    if (limit > 0) options.limits.joint_speeds.assign(6, limit);
    if (unknown_of >= 0)
      options.limits.joint_speeds[static_cast<std::size_t>(unknown_of)] = std::numeric_limits<double>::infinity();
    return testing::unwrap(machining::check(m, X_MW, e.program, e.interpretation, options));
  };
  const auto kinds = [](const std::vector<machining::CheckProblem>& of) {
    std::vector<std::string> out;
    for (const auto& p : of) out.push_back(p.kind);
    return out;
  };
  const char* beside = "G0 X0 Y0 Z-20 A0.3 B0 C0.3\nG1 Z20 F600\n";
  const auto unknown = checked(beside, 0);
  EXPECT_TRUE(unknown.ok);
  ASSERT_THAT(kinds(unknown.not_judged), ::testing::ElementsAre("way", "near singular"));
  EXPECT_THAT(unknown.not_judged[1].detail, ::testing::HasSubstr("deg on the last 1 mm"));
  EXPECT_THAT(kinds(checked(beside, 100).not_judged), ::testing::ElementsAre("way"));
  EXPECT_THAT(kinds(checked("G0 X0 Y0 Z-20 A20 B0 C0\nG1 Z20 F600\n", 0).not_judged), ::testing::ElementsAre("way"));
  const char* through = "G0 X0 Y0 Z-20 A0 B0 C0\nG1 Z0 F600\nZ20\n";
  const auto follows = checked(through, 100);
  EXPECT_TRUE(follows.ok);
  ASSERT_EQ(follows.passed.size(), 2u);
  EXPECT_EQ(follows.passed[0].line, 3);
  EXPECT_THAT(follows.notes, ::testing::Contains(::testing::HasSubstr("joints 4 and 6 can move together")));
  EXPECT_THAT(kinds(checked(through, 0).problems), ::testing::ElementsAre("singular", "singular"));
  EXPECT_THAT(kinds(checked(through, 100, 3).problems), ::testing::ElementsAre("singular", "singular"))
      << "nobody knows how fast joint 4 goes, which may have to swing there";
  EXPECT_TRUE(checked(through, 100, 0).ok) << "joint 1 has no part in it";
}

/// The accelerations of joints on a circle against dense differences of the joints in time, and against J^-1 of the
/// controller's acceleration along all three axes, either way.
TEST(Check, JointAccelerationsAreThoseOfTheWayAndTheController) {
  const double feed = 0.4, radius = 0.03;  // m/s, m
  const auto e =
      testing::with_program("slavkovic_square", "G21 G90 G94 G17\nG0 X30 Y0 Z0\nG3 X30 Y0 I-30 F24000\nM2\n");
  const Vec3 origin(0, -1.3, 0);
  const auto joints = [&](double time) {
    const double angle = feed * time / radius;
    const Vec3 p = origin + radius * Vec3(std::cos(angle), std::sin(angle), 0);
    return kinematics::inverse(e.job.machine, Pose{Mat3::Identity(), p}).reachable()->joints;
  };
  constexpr double kPi = std::numbers::pi, dt = 1e-4;
  double most = 0, by_tip = 0;
  for (int i = 0; i < 2000; ++i) {
    const double t = 2 * kPi * radius / feed * i / 2000;
    const machine::JointVector q = joints(t);
    most = std::max(most, ((joints(t + dt) - 2 * q + joints(t - dt)) / (dt * dt)).cwiseAbs().maxCoeff());
    if (i % 10 != 0) continue;
    const Pose X{Mat3::Identity(), origin + radius * Vec3(std::cos(feed * t / radius), std::sin(feed * t / radius), 0)};
    const auto solver = kinematics::jacobian(e.job.machine, X, q).leftCols(5).colPivHouseholderQr();
    for (int k = 0; k < 8; ++k) {  // linear, so the most is at a corner of the cube
      Vec6 twist = Vec6::Zero();
      twist.head<3>() = Vec3((k & 1) != 0 ? 1 : -1, (k & 2) != 0 ? 1 : -1, (k & 4) != 0 ? 1 : -1);
      by_tip = std::max(by_tip, solver.solve(twist).cwiseAbs().maxCoeff());
    }
  }
  machining::CheckOptions options;
  const auto checked = [&](double limit, double tip) {
    options.limits.joint_accelerations.assign(5, limit);
    options.limits.tip_acceleration = tip;
    return testing::unwrap(
        machining::check(e.job.machine, Pose{Mat3::Identity(), origin}, e.program, e.interpretation, options));
  };
  const auto feed_alone = checked(0.5 * most, 0);
  EXPECT_NEAR(feed_alone.hardest.share, 2, 0.01);
  EXPECT_NEAR(feed_alone.hardest.of_speed, feed_alone.hardest.share, 1e-12);
  EXPECT_EQ(feed_alone.hardest_line, 3);
  EXPECT_EQ(feed_alone.fastest_line, 0) << "no speed limits, no speed judged";
  ASSERT_EQ(feed_alone.problems.size(), 1U);
  EXPECT_EQ(feed_alone.problems[0].kind, "acceleration");
  EXPECT_THAT(feed_alone.problems[0].detail, ::testing::HasSubstr("it would keep it"));
  EXPECT_FALSE(checked(0.99 * most, 0).ok);
  EXPECT_TRUE(checked(1.01 * most, 0).ok);
  // A limit so large that the feed's part hardly counts: the controller's.
  const double tip = 1e4;
  const auto both = checked(1, tip);
  EXPECT_NEAR(both.hardest.share - both.hardest.of_speed, tip * by_tip, 2e-3 * tip * by_tip);
  EXPECT_LE(both.hardest.of_speed, most * 1.001);
  EXPECT_GT(both.hardest.share, tip * by_tip * 0.998);
}

/// Many short lines are straight each: what turns the tool between them is the controller's acceleration.
TEST(Check, ACircleOfShortLinesAsksForWhatTheControllerTakes) {
  std::string text = "G21 G90 G94\nG0 X30 Y0 Z0\nF24000\n";
  for (int i = 1; i <= 720; ++i) {
    const double angle = i * std::numbers::pi / 360;
    text += "G1 X" + std::to_string(30 * std::cos(angle)) + " Y" + std::to_string(30 * std::sin(angle)) + "\n";
  }
  const auto e = testing::with_program("slavkovic_square", text + "M2\n");
  machining::CheckOptions options;
  options.limits.joint_accelerations.assign(5, 1);
  const auto share = [&](double tip) {
    options.limits.tip_acceleration = tip;
    return testing::unwrap(machining::check(e.job.machine, Pose{Mat3::Identity(), Vec3(0, -1.3, 0)}, e.program,
                                            e.interpretation, options))
        .hardest.share;
  };
  // v^2 / r of the tip: what a controller that keeps the feed takes.
  const double on_lines = share(0.4 * 0.4 / 0.03);
  const auto arc =
      testing::with_program("slavkovic_square", "G21 G90 G94 G17\nG0 X30 Y0 Z0\nG3 X30 Y0 I-30 F24000\nM2\n");
  options.limits.tip_acceleration = 0;
  const double on_arc = testing::unwrap(machining::check(arc.job.machine, Pose{Mat3::Identity(), Vec3(0, -1.3, 0)},
                                                         arc.program, arc.interpretation, options))
                            .hardest.share;
  EXPECT_GE(on_lines, on_arc * 0.999);
  EXPECT_LT(on_lines, on_arc * 2);
}

// The tool stands somewhere over the table when a program begins: its first Z leads to no known place, and not to the
// origin of W, which the machine here cannot reach at all.
TEST(Check, AnEndThatIsNotKnownIsNotTakenAsTheOrigin) {
  const auto e = testing::with_program("slavkovic_square", "G21 G90 G94\nG0 Z20\nG0 X0 Y-1300\nG1 X20 F600\nM2\n");
  const auto r = check(e, Vec3(0, 0, 0));
  EXPECT_TRUE(r.ok) << r.problems[0].detail;
  ASSERT_EQ(r.not_judged.size(), 2u);
  EXPECT_EQ(r.not_judged[0].line, 2);
  EXPECT_EQ(r.not_judged[0].kind, "end");
  EXPECT_EQ(r.not_judged[0].detail, "X and Y are not known where it ends");
  EXPECT_EQ(r.not_judged[1].line, 3);
  EXPECT_EQ(r.not_judged[1].kind, "way");
  const auto nowhere =
      check(testing::with_program("slavkovic_square", "G21 G90\nG0 Z20\nG1 Z5 F600\nM2\n"), Vec3(0, -1300, 0));
  EXPECT_FALSE(nowhere.ok) << "nothing was judged";
  ASSERT_EQ(nowhere.problems.size(), 1u);
  EXPECT_EQ(nowhere.problems[0].kind, "empty");
}

/// An arm whose file gives no limits gets a turn each way: that its real joints keep theirs is not known.
TEST(Check, AssumedLimitsAreNoLimitsThatWereJudged) {
  const auto e = testing::with_program("slavkovic_square", "G21 G90 G94\nG0 X0 Y0 Z0\nG1 X9 F1000\nM2\n");
  const std::string text = machine::to_toml(e.job.machine);
  const std::size_t begin = text.find("limits = ["), end = text.find("]\n", begin);
  ASSERT_NE(end, std::string::npos);
  const std::string without = text.substr(0, begin) + text.substr(end + 2);
  const auto limits_not_judged = [&](const std::string& arm) {
    const auto r =
        testing::unwrap(machining::check(testing::unwrap(machine::from_text(arm, "arm.toml")),
                                         Pose{Mat3::Identity(), Vec3(0, -1.3, 0)}, e.program, e.interpretation));
    EXPECT_TRUE(r.ok);
    return std::count_if(r.not_judged.begin(), r.not_judged.end(), [](const machining::CheckProblem& p) {
      return p.kind == "limits" && p.line == 0 && p.detail.find("assumed") != std::string::npos;
    });
  };
  EXPECT_EQ(limits_not_judged(text), 0);
  EXPECT_EQ(limits_not_judged(without), 1);
  // Written and read again, they are still assumed.
  EXPECT_EQ(limits_not_judged(machine::to_toml(testing::unwrap(machine::from_text(without, "arm.toml")))), 1);
}

/// A fork head begins with the tool along C, which is free: it must stand as the first tilt will ask, tilted by an
/// infinitesimal (A, B) about x and y: the tool axis leans towards (B, -A), and at C = 0 the fork tilts it towards y.
TEST(Check, BeginsWithTheFreeJointWhereTheProgramGoesOn) {
  const machine::AnyMachine m = test::load("gantry-fork");
  const Pose X_MW{Mat3::Identity(), Vec3(0.1, 0.05, 0.3)};
  for (const auto& [a, b] : std::vector<std::pair<double, double>>{
           {20, 0}, {-20, 0}, {0, 20}, {0, -20}, {10, 20}, {-7, 3}, {1, -40}, {30, 30}, {-0.5, -0.1}}) {
    for (const std::string posture : {"", "tilt-positive", "tilt-negative"}) {
      const std::string text = fmt::format(
          "G21 G90 G94\nG0 X0 Y0 Z5 A0 B0\nX10\nG1 Y30 F1000\nG3 X20 Y40 I10\nG1 X50 A{} B{}\nX60 A0 B0\nM2\n", a, b);
      SCOPED_TRACE(text + posture);
      const auto e = testing::with_program("slavkovic_square", text);
      const auto begins = machining::look_ahead(m, X_MW, e.interpretation, posture);
      ASSERT_TRUE(begins.has_value());
      const double c = units::to_deg(begins->joints[3]);
      const double meant = units::to_deg(std::atan2(b, a));
      const bool positive = std::abs(std::remainder(c - meant, 360)) < 90;
      EXPECT_NEAR(std::remainder(c - meant - (positive ? 0 : 180), 360), 0, 1e-3);
      EXPECT_EQ(begins->posture, positive ? "tilt-positive" : "tilt-negative");
      EXPECT_NEAR(begins->joints[4], 0, 1e-6);
      if (posture.empty()) {
        EXPECT_LE(std::abs(c), 90 + 1e-3);  // the nearer of the two
      } else {
        EXPECT_EQ(begins->posture, posture);
      }
      machining::CheckOptions options;
      options.branch = posture;
      const auto fits = testing::unwrap(machining::check(m, X_MW, e.program, e.interpretation, options));
      EXPECT_TRUE(fits.ok) << fits.problems.front().detail;
      EXPECT_LT(fits.joints[3].max - fits.joints[3].min, units::from_deg(20));
      EXPECT_THAT(fits.notes, ::testing::Contains(::testing::HasSubstr(
                                  fmt::format("joint 4 at {:.1f} deg", std::round(10 * c) / 10 + 0.0))));
      // From elsewhere it does not.
      options.start = {begins->joints.begin(), begins->joints.end()};
      options.start[3] = begins->joints[3] + (begins->joints[3] < 0 ? 1 : -1);
      EXPECT_FALSE(testing::unwrap(machining::check(m, X_MW, e.program, e.interpretation, options)).ok);
    }
  }
}

/// A straight wrist begins with joints 4 and 6 as the first turn of the tool will ask: those of the inverse next to it.
TEST(Check, BeginsWithAStraightWristWhereTheProgramGoesOn) {
  const machine::AnyMachine m = test::load(
      "kuka-kr210", {{"tool.x_mm", "300"}, {"tool.z_mm", "150"}, {"tool.a_deg", "0"}, {"tool.b_deg", "-90"}});
  const machine::JointVector q =
      (machine::JointVector(6) << 0, units::from_deg(-60), units::from_deg(60), 0, 0, 0).finished();
  const Pose X_0 = kinematics::forward(m, q).poses.front();
  const auto e =
      testing::with_program("slavkovic_square", "G21 G90 G94\nG0 X0 Y0 Z0 A0 B0 C0\nG1 A10 B5 F1000\nX-8 Y30\nM2\n");
  for (const std::string posture : {"front elbow-up", "front elbow-up wrist-flipped"}) {
    const auto begins = machining::look_ahead(m, Pose{Mat3::Identity(), X_0.p}, e.interpretation, posture);
    ASSERT_TRUE(begins.has_value());
    EXPECT_EQ(begins->posture, posture);
    const Pose beside{rotation_abc(1e-5, 0.5e-5, 0), X_0.p};
    const auto inverse = kinematics::inverse_near(m, beside, begins->joints);
    EXPECT_EQ(kinematics::branch_name(m, inverse.reachable()->branch), posture);
    EXPECT_LT((inverse.reachable()->joints - begins->joints).cwiseAbs().maxCoeff(), 1e-4);
    EXPECT_LT((kinematics::forward(m, begins->joints).poses.front().p - X_0.p).norm(), 1e-9);
  }
  // Where the wrist is not straight nothing is open.
  const auto bent = testing::with_program("slavkovic_square", "G21 G90 G94\nG0 X0 Y0 Z0 A0 B1 C0\nG1 A10 F1000\nM2\n");
  EXPECT_FALSE(machining::look_ahead(m, Pose{Mat3::Identity(), X_0.p}, bent.interpretation, "").has_value());
}

TEST(Check, AProgramWithoutAMoveIsNoYes) {
  const auto r = check(testing::with_program("slavkovic_square", "G21 G90\n(nothing)\nM2\n"), Vec3(0, -1300, 0));
  EXPECT_FALSE(r.ok);
  ASSERT_EQ(r.problems.size(), 1u);
  EXPECT_EQ(r.problems[0].kind, "empty");
}

TEST(Check, AnAxisThatTheMachineDoesNotHaveIsNoYes) {
  auto e = testing::with_program("slavkovic_square", "G21 G90 G94\nG0 X0 Y0 Z0\nG1 X5 C30 F1000\nG1 X9 C0\nM2\n");
  auto r = check(e, Vec3(0, -1300, 0));
  EXPECT_FALSE(r.ok);
  ASSERT_EQ(r.problems.size(), 1u);
  EXPECT_EQ(r.problems[0].kind, "axis");
  EXPECT_EQ(r.problems[0].line, 3);
  // A tripod whose tilt follows cannot tilt its tool as it is told.
  e = testing::with_program("slavkovic_square", "G21 G90 G94\nG0 X1 Y1 Z1\nG1 Z2 A45 F1000\nM2\n");
  const auto tricept = machine::load("tricept").value();
  const auto tripod =
      testing::unwrap(machining::check(tricept, Pose{Mat3::Identity(), Vec3(0, 0, 1.2)}, e.program, e.interpretation));
  EXPECT_FALSE(tripod.ok);
  EXPECT_EQ(tripod.problems.at(0).kind, "axis");
}

/// A straight wrist that the program passes exactly, so that no joint hurries; corrected by a tenth of a millimetre
/// aside, joint 6 would have to turn by half a turn there. A yes would make it worse.
TEST(Check, ACorrectionThatMakesAJointTooFastIsNoYes) {
  testing::Example e =
      testing::with_program("slavkovic_square",
                            "G17 G21 G40 G49 G80 G90 G94\nG54\nT1 M6\nS8000 M3\nG0 X0 Y-170 Z10\nG0 Z-1\n"
                            "G1 Y170 F1000\nG0 Z10\nM2\n");
  auto arm = std::get<machine::SerialArm>(test::load("kuka-kr210"));
  arm.X_FT.R = rotation_abc(units::from_deg(90), 0, 0);
  arm.X_MB.R = rotation_abc(0, 0, units::from_deg(90));
  for (std::size_t i = 0; i < 6; ++i) arm.dh[i].compliance = i < 3 ? 1e-6 : 2e-6;
  e.job.machine = machine::AnyMachine(arm);
  e.job.X_MW.p = Vec3(0, 1.4, 1.7);
  e.job.stock = testing::unwrap(cutting::Stock::block(Vec3(-0.04, -0.15, -0.02), Vec3(0.04, 0.15, 0), 0.5e-3));
  e.job.joint_speeds = std::vector<double>(6, units::from_deg(100));
  const machining::Correction no = testing::correct(e);
  EXPECT_FALSE(no.within_tolerance);
  EXPECT_TRUE(no.joint_too_fast);
  EXPECT_LT(no.largest_after, e.job.tolerance);
  EXPECT_THAT(no.answer(), ::testing::StartsWith("no: a joint of the corrected program would be too fast"));
  EXPECT_THAT(no.answer(), ::testing::HasSubstr("joint 6 would go at"));
  ASSERT_EQ(no.remedies.size(), 1U);
  // As programmed it is fast already: a note says so, and the correction makes it no worse.
  e.job.joint_speeds = std::vector<double>(6, units::from_deg(0.01));
  const machining::Correction noted = testing::correct(e);
  EXPECT_FALSE(noted.joint_too_fast);
  EXPECT_THAT(noted.before.notes, ::testing::Contains(::testing::HasSubstr("too fast for a joint")));
  EXPECT_THAT(testing::predict(e).notes, ::testing::Contains(::testing::HasSubstr("`polypod check` answers no")));
  // So is a joint that would accelerate too fast: half a millimetre from the straight wrist the correction comes
  // nearer.
  testing::Example beside = e;
  beside.program = testing::unwrap(
      gcode::parse("G17 G21 G40 G49 G80 G90 G94\nG54\nT1 M6\nS8000 M3\nG0 X-0.5 Y-170 Z10\nG0 Z-1\nG1 Y170 F1000\nG0 "
                   "Z10\nM2\n",
                   "beside.ngc"));
  beside.interpretation = testing::unwrap(gcode::interpret(beside.program, e.job.interpret_options()));
  beside.job.joint_speeds = std::vector<double>(6, units::from_deg(1e5));
  beside.job.joint_accelerations = std::vector<double>(6, units::from_deg(1e6));
  EXPECT_TRUE(testing::correct(beside).within_tolerance);
  for (const double room : {2.0, 1.1}) {  // the nearer a joint is to its limit, the closer it is looked at
    machining::CheckOptions options;
    options.limits = machining::motion_limits(beside.job);
    const auto programmed = testing::unwrap(
        machining::check(beside.job.machine, beside.job.X_MW, beside.program, beside.interpretation, options));
    for (double& limit : beside.job.joint_accelerations) limit *= room * programmed.hardest.share;
  }
  const machining::Correction harder = testing::correct(beside);
  EXPECT_TRUE(harder.joint_too_fast) << harder.answer();
  EXPECT_THAT(harder.answer(), ::testing::HasSubstr("joint 6 would accelerate with up to"));
  // Where no speed is known the joint would jump.
  e.job.joint_speeds.clear();
  const auto refused = machining::correct(e.job, e.program, e.interpretation);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().id, "MC210");
  EXPECT_THAT(refused.error().message, ::testing::StartsWith("once corrected, "));
  // The other position of block delete is judged as well: there the feed is larger.
  e.program = testing::unwrap(
      gcode::parse("G17 G21 G40 G49 G80 G90 G94\nG54\nT1 M6\nS8000 M3\nG0 X0 Y-170 Z10\nG0 Z-1\nF1000\n/F1300\n"
                   "G1 Y170\nG0 Z10\nM2\n",
                   "both.ngc"));
  e.job.tolerance = 60e-6;
  e.job.block_delete = true;
  e.interpretation = testing::unwrap(gcode::interpret(e.program, e.job.interpret_options()));
  e.job.joint_speeds = std::vector<double>(6, units::from_deg(4800));  // 4192 and 1.3 times that
  const machining::Correction both = testing::correct(e);
  EXPECT_TRUE(both.joint_too_fast) << both.answer();
  EXPECT_THAT(both.answer(), ::testing::HasSubstr("(with block delete off)"));
}

}  // namespace
}  // namespace polypod
