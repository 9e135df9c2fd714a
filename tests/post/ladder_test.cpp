// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The cheapest way on a ladder against every way there is, and the free turn of six-axis arms.
#include "polypod/post/ladder.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <numbers>
#include <random>

#include "parts.hpp"
#include "polypod/core/units.hpp"
#include "polypod/families/serial/kinematics.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod {
namespace {

using post::LadderSize;
using post::LadderWay;
using test::value;

struct RandomLadder {
  LadderSize size;
  std::vector<double> states, steps;
  [[nodiscard]] int count() const { return size.rungs * size.columns; }
  [[nodiscard]] double state(std::size_t n, int j) const {
    return states[n * static_cast<std::size_t>(count()) + static_cast<std::size_t>(j)];
  }
  [[nodiscard]] double step(std::size_t n, int i, int j) const {
    const auto m = static_cast<std::size_t>(count());
    return steps[(n * m + static_cast<std::size_t>(i)) * m + static_cast<std::size_t>(j)];
  }
};

RandomLadder random_ladder(std::mt19937& random) {
  constexpr double kNone = std::numeric_limits<double>::infinity();
  RandomLadder out;
  const auto pick = [&](unsigned from, unsigned count) { return static_cast<int>(from + random() % count); };
  out.size.points = 2 + random() % 4;
  out.size.rungs = pick(1, 5);
  out.size.farthest = pick(1, 3);
  out.size.around = random() % 2 == 0;
  out.size.columns = pick(1, 3);
  out.size.farthest_column = pick(1, 2);
  std::uniform_real_distribution<double> cost(0, 1);
  const auto m = static_cast<std::size_t>(out.count());
  for (std::size_t k = 0; k < out.size.points * m; ++k) out.states.push_back(random() % 5 == 0 ? kNone : cost(random));
  for (std::size_t k = 0; k < out.size.points * m * m; ++k) {
    out.steps.push_back(random() % 5 == 0 ? kNone : cost(random));
  }
  return out;
}

bool near_enough(const LadderSize& size, int i, int j) {
  const int d = std::abs(i % size.rungs - j % size.rungs);
  return (size.around ? std::min(d, size.rungs - d) : d) <= size.farthest &&
         std::abs(i / size.rungs - j / size.rungs) <= size.farthest_column;
}

/// Every way, one by one.
double by_brute_force(const RandomLadder& ladder, std::size_t n, int last) {
  if (n == ladder.size.points) return 0;
  double best = std::numeric_limits<double>::infinity();
  for (int j = 0; j < ladder.count(); ++j) {
    double cost = ladder.state(n, j);
    if (n > 0) {
      if (!near_enough(ladder.size, last, j)) continue;
      cost += ladder.step(n, last, j);
    }
    if (std::isfinite(cost)) best = std::min(best, cost + by_brute_force(ladder, n + 1, j));
  }
  return best;
}

TEST(Ladder, CheapestOfAllWays) {
  std::mt19937 random(7);
  int without = 0;
  for (int round = 0; round < 2000; ++round) {
    const RandomLadder ladder = random_ladder(random);
    const LadderWay way = post::cheapest_way(
        ladder.size, [&](std::size_t n, int j) { return ladder.state(n, j); },
        [&](std::size_t n, int i, int j) { return ladder.step(n, i, j); }, [](std::size_t, int, int) {});
    const double best = by_brute_force(ladder, 0, 0);
    if (!std::isfinite(best)) {
      EXPECT_TRUE(way.rungs.empty());
      ++without;
      continue;
    }
    ASSERT_EQ(way.rungs.size(), ladder.size.points);
    EXPECT_NEAR(way.cost, best, 1e-12);
    // The way that is given costs what is said of it.
    const auto state = [&](std::size_t n) {
      const int m = ladder.size.rungs;
      return way.columns[n] * m + ((way.rungs[n] % m) + m) % m;
    };
    double sum = 0;
    for (std::size_t n = 0; n < ladder.size.points; ++n) {
      sum += ladder.state(n, state(n));
      if (n == 0) continue;
      sum += ladder.step(n, state(n - 1), state(n));
      EXPECT_LE(std::abs(way.rungs[n] - way.rungs[n - 1]), ladder.size.farthest);
      EXPECT_LE(std::abs(way.columns[n] - way.columns[n - 1]), ladder.size.farthest_column);
    }
    EXPECT_NEAR(sum, best, 1e-12);
  }
  EXPECT_GT(without, 50);
}

/// A path of small steps with the tool tilted this way and that, at a feed.
post::Path wavy(int points, double feed_mm_per_min = 1200) {
  std::string text = fmt::format("UNITS/MM\nRAPID\nGOTO/0,0,0,0,0,1\nFEDRAT/{:g}\n", feed_mm_per_min);
  for (int i = 1; i < points; ++i) {
    const double t = double(i) / points, a = 0.3 * std::sin(9 * t), b = 0.3 * std::cos(7 * t);
    const double k = std::sqrt(1 - a * a - b * b);
    text += fmt::format("GOTO/{:.5f},{:.5f},{:.5f},{:.8f},{:.8f},{:.8f}\n", 300 * t, 100 * std::sin(6 * t),
                        20 * std::cos(5 * t), a, b, k);
  }
  return value(post::parse_cl(text + "FINI\n", "wavy.cl"));
}

/// The KUKA with a spindle across its flange, as milling robots have it.
machine::AnyMachine milling_kuka() {
  machine::AnyMachine m = test::load("kuka-kr210");
  auto& arm = std::get<machine::SerialArm>(m);
  arm.X_FT = arm.X_FT * Pose{rotation_y(units::from_deg(90)), {0.3, 0, -0.2}};
  return m;
}

post::PlanOptions at(const Vec3& origin) {
  post::PlanOptions options;
  options.origin = origin;
  options.c.reset();
  return options;
}

TEST(FreeTurn, FollowsAPathWithinLimitsAndSpeeds) {
  const post::Path path = wavy(200);
  const post::Configuration six = value(post::configure(milling_kuka(), "six"));
  post::PlanOptions options = at({1.4, 0.2, 0.6});
  options.joint_speeds.assign(6, units::from_deg(100));
  const post::Plan plan = value(post::plan(six, path, options));
  for (const auto& p : plan.problems) ADD_FAILURE() << p.line << " " << p.kind << " " << p.detail;
  EXPECT_FALSE(plan.branch.empty());
  EXPECT_GT(plan.speed_joint, 0);
  EXPECT_LE(plan.speed_share, 1);
  // By forward kinematics of its joints, each written pose is the one asked for.
  const post::PlannedMove* before = nullptr;
  double fastest = 0;
  for (const post::PlannedMove& m : plan.moves) {
    const Pose X = kinematics::forward(six.machine, m.joints).poses.front();
    EXPECT_LT((X.p - (options.origin + m.tip)).norm(), 1e-9);
    EXPECT_LT(angle_between(X.R.col(2), path.steps[static_cast<std::size_t>(m.step)].axis), 5e-3 + 2e-3);
    if (before != nullptr && m.kind != post::StepKind::rapid && m.seconds > 0) {
      fastest = std::max(fastest, (m.joints - before->joints).cwiseAbs().maxCoeff() / m.seconds);
    }
    before = &m;
  }
  // From point to point the joints are at most as fast as between them.
  EXPECT_LE(fastest / units::from_deg(100), plan.speed_share * (1 + 1e-6));
  EXPECT_GT(fastest / units::from_deg(100), 0.3 * plan.speed_share);
}

TEST(FreeTurn, BeginsWhereTheArmStands) {
  const post::Path path = wavy(20);
  const post::Configuration six = value(post::configure(milling_kuka(), "six"));
  post::PlanOptions options = at({1.4, 0.2, 0.6});
  std::vector<std::string> postures;
  for (const kinematics::Solution& s :
       kinematics::inverse(six.machine, {rotation_abc(0, 0, 0.5), options.origin}).solutions) {
    if (s.violations != 0) continue;
    options.start_joints = s.joints;
    const std::string posture = kinematics::branch_name(six.machine, s.branch);
    const auto plan = post::plan(six, path, options);
    if (!plan || !plan->ok()) continue;
    EXPECT_EQ(plan->branch, posture);
    postures.push_back(posture);
    // Not farther from those joints than without being told of them.
    post::PlanOptions untold = at({1.4, 0.2, 0.6});
    untold.branch = posture;
    const post::Plan other = value(post::plan(six, path, untold));
    const auto off = [&](const post::Plan& p) { return (p.moves.front().joints - s.joints).norm(); };
    EXPECT_LE(off(*plan), off(other) + 1e-9) << posture;
  }
  EXPECT_GE(postures.size(), 2u);
}

/// Straight over a wrist singularity at a small distance: joints 4 and 6 would turn by half a turn within millimetres.
TEST(FreeTurn, NearAWristSingularityKeepsSpeedsOrRefusesTheLine) {
  const post::Configuration six = value(post::configure(test::load("kuka-kr210"), "six"));
  // The tool lies along axis 6, and joint 5 is nearly straight.
  machine::JointVector q(6);
  q << 0.1, -1.2, 1.3, 0.0, 0.002, 0.0;
  const Pose X = kinematics::forward(six.machine, q).poses.front();
  const Vec3 k = X.R.col(2);
  machine::JointVector bent = q;
  bent[4] += 1e-4;
  // Across the way on which joint 5 alone would turn the axis: past the singular direction at 0.002 rad.
  const Vec3 side = k.cross(kinematics::forward(six.machine, bent).poses.front().R.col(2) - k).normalized();
  std::string text = "UNITS/MM\nRAPID\n";
  const auto point = [&](double along) {
    const Vec3 axis = (k + along * side).normalized();
    const Vec3 tip = 1000 * along * side;
    text += fmt::format("GOTO/{:.6f},{:.6f},{:.6f},{:.9f},{:.9f},{:.9f}\n", tip.x(), tip.y(), tip.z(), axis.x(),
                        axis.y(), axis.z());
  };
  point(-0.05);
  text += "FEDRAT/6000\n";
  for (int i = -49; i <= 50; ++i) point(0.001 * i);
  const post::Path path = value(post::parse_cl(text + "FINI\n", "singular.cl"));
  post::PlanOptions options;
  options.origin = X.p;
  options.c = angles_abc(X.R).z();
  const post::Plan free = value(post::plan(six, path, options));
  options.joint_speeds = {2.1, 2.0, 2.0, 3.1, 3.0, 3.8};
  const post::Plan plan = value(post::plan(six, path, options));
  double fastest = 0;
  for (std::size_t i = 1; i < plan.moves.size(); ++i) {
    const post::PlannedMove &a = plan.moves[i - 1], &b = plan.moves[i];
    if (b.kind == post::StepKind::rapid || a.joints.size() == 0 || b.joints.size() == 0) continue;
    for (int j = 0; j < 6; ++j) {
      fastest = std::max(
          fastest, std::abs(b.joints[j] - a.joints[j]) / b.seconds / options.joint_speeds[static_cast<std::size_t>(j)]);
    }
  }
  // The oracle: differences of the joints from point to point. Where they are beyond the limit a line is named.
  if (fastest > 1) {
    EXPECT_THAT(plan.problems, ::testing::Contains(::testing::Field(&post::PlanProblem::kind, "speed")));
  }
  EXPECT_GE(plan.speed_share, fastest * (1 - 1e-6));
  EXPECT_GT(plan.speed_share, 1) << "a feed of 100 mm/s past the singular pose is too fast";
  ASSERT_FALSE(plan.ok());
  // At the feed that the message gives there is no problem with the speed.
  const post::PlanProblem& p = plan.problems.front();
  EXPECT_EQ(p.kind, "speed");
  EXPECT_THAT(p.detail, ::testing::HasSubstr("joint"));
  EXPECT_GT(p.line, 2);
  // It was the feed for the first place where a joint is too fast, not for the worst.
  const std::size_t at = p.detail.find("; up to ");
  ASSERT_NE(at, std::string::npos) << p.detail;
  const double keeps = std::stod(p.detail.substr(at + 8));
  post::Path slower = path;
  for (post::Step& s : slower.steps)
    if (s.line == p.line) s.feed = units::from_mm_per_min(keeps);
  const post::Plan kept = value(post::plan(six, slower, options));
  EXPECT_TRUE(std::none_of(kept.problems.begin(), kept.problems.end(), [&](const post::PlanProblem& other) {
    return other.line == p.line && other.kind == "speed";
  }));
}

TEST(FreeTurn, WithSlowJointsTheLineIsNamed) {
  const post::Path path = wavy(60, 60000);
  const post::Configuration six = value(post::configure(milling_kuka(), "six"));
  post::PlanOptions options = at({1.4, 0.2, 0.6});
  options.joint_speeds.assign(6, units::from_deg(0.5));
  const auto plan = post::plan(six, path, options);
  ASSERT_FALSE(plan);
  EXPECT_EQ(plan.error().id, "PO123");
  EXPECT_GT(plan.error().place.line, 3);
}

TEST(FreeTurn, CountsOfSpeedsAndJoints) {
  const post::Path path = wavy(10);
  const post::Configuration six = value(post::configure(milling_kuka(), "six"));
  post::PlanOptions options = at({1.4, 0.2, 0.6});
  options.joint_speeds.assign(5, 1);
  const auto plan = post::plan(six, path, options);
  ASSERT_FALSE(plan);
  EXPECT_EQ(plan.error().id, "PO127");
  options.joint_speeds.clear();
  options.start_joints.emplace(6);
  *options.start_joints << 0, units::from_deg(-90), units::from_deg(90), 0, 0, units::from_deg(4000);
  const auto beyond = post::plan(six, path, options);
  ASSERT_FALSE(beyond);
  EXPECT_EQ(beyond.error().id, "PO127");
  EXPECT_THAT(beyond.error().message, testing::HasSubstr("joint 6 cannot start at 4000 deg"));
}

/// A program in X, Y and Z alone leaves C free: the ladder may turn the tool.
TEST(FreeTurn, OfProgramsWithoutAngles) {
  post::Path path = wavy(40);
  for (post::Step& s : path.steps) {
    s.axis = Vec3::UnitZ();
    s.angles = Vec3::Zero();
    s.turned = false;
  }
  const post::Configuration six = value(post::configure(milling_kuka(), "six"));
  post::PlanOptions options = at({1.4, 0.2, 0.6});
  // The arm stands at the first point with C = 1.
  for (const kinematics::Solution& s :
       kinematics::inverse(six.machine, {rotation_abc(0, 0, 1), options.origin}).solutions) {
    if (s.violations == 0 && !options.start_joints) options.start_joints = s.joints;
  }
  ASSERT_TRUE(options.start_joints);
  const post::Plan plan = value(post::plan(six, path, options));
  EXPECT_TRUE(plan.ok());
  for (const post::PlannedMove& m : plan.moves) {
    EXPECT_LT(angle_between(kinematics::forward(six.machine, m.joints).poses.front().R.col(2), Vec3::UnitZ()), 1e-6);
  }
  EXPECT_GT(std::abs(plan.moves.front().angles.z()), 0.3);
}

/// A stiff joint is worth turning to: with one soft joint, the compliance across the path is smaller than without.
TEST(FreeTurn, TurnsToWhereItIsStiff) {
  const post::Path path = wavy(40);
  machine::AnyMachine m = milling_kuka();
  const auto compliance_of = [&](const machine::AnyMachine& used) {
    const post::Configuration six = value(post::configure(used, "six"));
    const post::Plan plan = value(post::plan(six, path, at({1.4, 0.2, 0.6})));
    double sum = 0;
    for (std::size_t i = 1; i < plan.moves.size(); ++i) {
      const Vec3 along = plan.moves[i].tip - plan.moves[i - 1].tip;
      const Vec3 n = plan.moves[i].R.col(2).cross(along).normalized();
      const auto J = machine::forward_jacobian(std::get<machine::SerialArm>(used), plan.moves[i].joints).J;
      const double lever = n.dot(J.col(4).head<3>());  // joint 5 alone is soft
      sum += lever * lever;
    }
    return sum;
  };
  const double without = compliance_of(m);
  std::get<machine::SerialArm>(m).dh[4].compliance = 1e-6;
  EXPECT_LE(compliance_of(m), without * 1.0001);
}

}  // namespace
}  // namespace polypod
