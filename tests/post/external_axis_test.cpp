// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Robots on a rail in their own languages: where the rail stands belongs to every point.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <regex>
#include <sstream>

#include "parts.hpp"
#include "polypod/families/serial/carried_arm.hpp"
#include "polypod/families/serial/kinematics.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod {
namespace {

using machine::CarriedArm;
using machine::JointVector;
using machine::SerialArm;
using post::Dialect;
using post::External;
using test::value;

/// A KUKA with a spindle across its flange on 4 m of rail along x of M.
SerialArm kuka_on_rail() {
  auto arm = std::get<SerialArm>(test::load("kuka-kr210"));
  arm.X_FT = arm.X_FT * Pose{rotation_y(units::from_deg(90)), {0.3, 0, -0.2}};
  machine::DhRow rail;
  rail.kind = machine::JointKind::prismatic;
  rail.theta_offset = units::from_deg(90);
  rail.range = {0, 4};
  rail.speed = 1.5;
  arm.dh.front().alpha = units::from_deg(-90);
  arm.dh.insert(arm.dh.begin(), rail);
  arm.X_MB = {rotation_y(units::from_deg(90)), Vec3::Zero()};
  return arm;
}

/// Cuts along x, longer than the arm reaches from one place, with a tilted tool and an arc at the end.
post::Path long_part(double length_mm = 3500) {
  std::string text = "UNITS/MM\nRAPID\nGOTO/0,0,50,0,0,1\nFEDRAT/3000\nGOTO/0,0,0,0,0,1\n";
  for (double x = 100; x <= length_mm; x += 100) {
    const double a = 0.2 * std::sin(x / 500);
    text += fmt::format("GOTO/{:g},{:.4f},0,0,{:.8f},{:.8f}\n", x, 100 * std::sin(x / 400), std::sin(a), std::cos(a));
  }
  return value(post::parse_cl(text + "FINI\n", "long.cl"));
}

constexpr double kOriginX = 0.2, kOriginY = 1.5, kOriginZ = 0.6;

struct Planned {
  post::Configuration configuration;
  post::Path path;
  post::Plan plan;
  post::PlanOptions options;
};

Planned plan_of(const SerialArm& arm, const post::Path& path, post::PlanOptions options, Dialect dialect) {
  post::set_for(dialect, options);
  options.origin = {kOriginX, kOriginY, kOriginZ};
  options.joint_speeds = kinematics::joint_count(machine::AnyMachine(arm)) == 7
                             ? std::vector<double>{1.5, 1, 1, 1, 1.5, 1.5, 2}
                             : std::vector<double>{1, 1, 1, 1.5, 1.5, 2};
  Planned out{value(post::configure(machine::AnyMachine(arm), "six")), path, {}, options};
  out.plan = value(post::plan(out.configuration, path, options));
  for (const auto& p : out.plan.problems) ADD_FAILURE() << p.line << " " << p.kind << " " << p.detail;
  return out;
}

std::string written(Dialect dialect, const Planned& planned) {
  post::WriteOptions options;
  options.origin = planned.options.origin;
  return value(post::write(dialect, planned.configuration, planned.path, planned.plan, options)).text;
}

struct Read {
  Pose X;
  double external = 0;  // m
  int status = 0, turns = 0;
};

/// PTP and LIN of KRL with their E1.
std::vector<Read> read_krl(const std::string& text, Pose& base) {
  static const std::regex frame(
      R"(^(\S+)[ =]\{X ([^,]+),Y ([^,]+),Z ([^,]+),A ([^,]+),B ([^,]+),C ([^,}]+)(?:,S (\d+),T (\d+),E1 ([^}]+))?\}.*)");
  std::vector<Read> out;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::smatch m;
    if (!std::regex_match(line, m, frame)) continue;
    const auto at = [&](std::size_t i) { return std::stod(m[i]); };
    const Pose X{rotation_abc(units::from_deg(at(7)), units::from_deg(at(6)), units::from_deg(at(5))),
                 Vec3(at(2), at(3), at(4)) * 1e-3};
    if (m[1] == "$BASE") base = X;
    if (m[1] != "PTP" && m[1] != "LIN") continue;
    EXPECT_TRUE(m[10].matched) << line;
    out.push_back({X, at(10) * 1e-3, std::stoi(m[8]), std::stoi(m[9])});
  }
  return out;
}

/// What the controller makes of a point: the joints of the arm whose root stands at E1, in the posture of S and T.
void expect_reached(const SerialArm& arm, const Pose& base, const Read& point, const Vec3& tip_M, const Vec3& axis_M) {
  SerialArm to_root = arm;  // the rail alone
  to_root.dh.resize(1);
  to_root.X_FT = Pose{};
  // The base of the robot as its maker draws it: the twist before its first axis belongs to the rail.
  const Pose twist{rotation_x(arm.dh[1].alpha), Vec3(arm.dh[1].a, 0, 0)};
  const Pose root_0 = machine::forward(to_root, JointVector::Zero(1)) * twist;
  EXPECT_LT(angle_between(root_0.R.col(2), Vec3::UnitZ()), 1e-12) << "it stands upright";
  const Pose root = machine::forward(to_root, JointVector::Constant(1, point.external));
  // The rows of the arm itself, the twist before its first axis being a part of the rail's frame.
  SerialArm robot = arm;
  robot.dh.erase(robot.dh.begin());
  robot.X_MB = root;
  const Pose X = root_0 * base * point.X;
  EXPECT_LT((X.p - tip_M).norm(), 1e-6);
  EXPECT_LT(angle_between(X.R.col(2), axis_M), 1e-6);
  int found = 0;
  for (const kinematics::Solution& s : machine::inverse(robot, X).solutions) {
    int turns = 0;
    for (int i = 0; i < 6; ++i) turns |= (s.joints[i] < -1e-6 ? 1 : 0) << i;
    found += s.violations == 0 && turns == point.turns ? 1 : 0;
  }
  EXPECT_GE(found, 1) << "E1 " << point.external;
}

TEST(ExternalAxis, IsWrittenWithEveryPoint) {
  const SerialArm arm = kuka_on_rail();
  post::PlanOptions options;
  options.external = External::chosen;
  const Planned planned = plan_of(arm, long_part(), options, Dialect::krl);
  Pose base;
  const std::vector<Read> points = read_krl(written(Dialect::krl, planned), base);
  ASSERT_EQ(points.size(), planned.plan.moves.size());
  double low = 1e9, high = -1e9;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const post::PlannedMove& m = planned.plan.moves[i];
    ASSERT_EQ(m.joints.size(), 7);
    EXPECT_NEAR(points[i].external, m.joints[0], 1e-7);
    EXPECT_EQ(m.external, m.joints[0]);
    expect_reached(arm, base, points[i], planned.options.origin + m.tip, m.R.col(2));
    const Pose X = machine::forward(arm, m.joints);
    EXPECT_LT((X.p - planned.options.origin - m.tip).norm(), 1e-9);
    low = std::min(low, points[i].external);
    high = std::max(high, points[i].external);
    // Half way to the next point with the rail half way, the arm follows within its limits.
    if (i + 1 == points.size()) continue;
    const post::PlannedMove& n = planned.plan.moves[i + 1];
    const Pose half{m.R * rotation_of(0.5 * rotation_vector(m.R.transpose() * n.R)),
                    planned.options.origin + 0.5 * (m.tip + n.tip)};
    const CarriedArm carried = *CarriedArm::on_external_axis(arm);
    const double at = 0.5 * (m.external + n.external);
    const auto between = carried.whole(
        kinematics::inverse_near(machine::AnyMachine(carried.arm()), carried.seen(half, at), m.joints.tail(6)), at);
    ASSERT_NE(between.reachable(), nullptr);
    EXPECT_LT((between.reachable()->joints - 0.5 * (m.joints + n.joints)).cwiseAbs().maxCoeff(), 0.05);
  }
  EXPECT_GT(high - low, 0.5) << "3.5 m are out of reach of one place";
}

TEST(ExternalAxis, OfRapidIsTheFirst) {
  const SerialArm arm = kuka_on_rail();
  post::PlanOptions options;
  options.external = External::chosen;
  const Planned planned = plan_of(arm, long_part(), options, Dialect::rapid);
  const std::string text = written(Dialect::rapid, planned);
  static const std::regex target(R"(Move[JL] \[\[[^\]]*\],\[[^\]]*\],\[[^\]]*\],\[([^,]+),9E9,9E9,9E9,9E9,9E9\]\])");
  std::size_t i = 0;
  for (std::sregex_iterator it(text.begin(), text.end(), target), end; it != end; ++it, ++i) {
    ASSERT_LT(i, planned.plan.moves.size());
    EXPECT_NEAR(std::stod((*it)[1]), 1e3 * planned.plan.moves[i].external, 1e-4);
  }
  EXPECT_EQ(i, planned.plan.moves.size());
}

/// The rail that is chosen keeps the arm farther from its limits and from singular poses than the nearest does.
TEST(ExternalAxis, IsChosenAlongTheWholeProgram) {
  const SerialArm arm = kuka_on_rail();
  post::PlanOptions options;
  options.external = External::chosen;
  const Planned chosen = plan_of(arm, long_part(), options, Dialect::krl);
  const auto worst = [&](const post::Plan& plan) {
    double share = 1;
    for (const post::PlannedMove& m : plan.moves) {
      for (int i = 0; i < 7; ++i) {
        const machine::JointRange r = joint_range(arm, i);
        share = std::min(share, std::min(m.joints[i] - r.min, r.max - m.joints[i]) / (r.max - r.min));
      }
    }
    return share;
  };
  options.external = External::linear;
  const Planned following = plan_of(arm, long_part(), options, Dialect::krl);
  EXPECT_GT(worst(chosen.plan), worst(following.plan));
  EXPECT_GT(worst(chosen.plan), 0.02);
}

/// C and the rail together, where both are left open.
TEST(ExternalAxis, WithTheFreeTurn) {
  const SerialArm arm = kuka_on_rail();
  post::PlanOptions options;
  options.external = External::chosen;
  options.c.reset();
  const Planned planned = plan_of(arm, long_part(), options, Dialect::krl);
  double turned = 0;
  for (const post::PlannedMove& m : planned.plan.moves) {
    const Pose X = machine::forward(arm, m.joints);
    EXPECT_LT((X.p - planned.options.origin - m.tip).norm(), 1e-9);
    EXPECT_LT(angle_between(X.R.col(2), planned.path.steps[static_cast<std::size_t>(m.step)].axis), 5e-3);
    turned = std::max(turned, std::abs(m.angles.z()));
  }
  EXPECT_GT(turned, 0.01);
}

TEST(ExternalAxis, StandsWhereItIsTold) {
  const SerialArm arm = kuka_on_rail();
  post::PlanOptions options;
  options.external = External::stands;
  options.external_at = 0.9;
  const Planned planned = plan_of(arm, long_part(800), options, Dialect::krl);
  for (const post::PlannedMove& m : planned.plan.moves) EXPECT_EQ(m.joints[0], 0.9);
  // 3.5 m are more than the arm reaches from there.
  options.origin = {kOriginX, kOriginY, kOriginZ};
  post::set_for(Dialect::krl, options);
  const post::Plan plan = value(post::plan(planned.configuration, long_part(), options));
  ASSERT_FALSE(plan.ok());
  EXPECT_GT(plan.problems.front().line, 10);
}

/// A rail that the machine file locks: six joints move, and E1 says where it stands.
TEST(ExternalAxis, ThatIsLocked) {
  SerialArm arm = kuka_on_rail();
  arm.dh.front().locked = 0.9;
  const Planned planned = plan_of(arm, long_part(800), {}, Dialect::krl);
  Pose base;
  const std::vector<Read> points = read_krl(written(Dialect::krl, planned), base);
  ASSERT_EQ(points.size(), planned.plan.moves.size());
  const SerialArm free = kuka_on_rail();
  for (std::size_t i = 0; i < points.size(); ++i) {
    EXPECT_EQ(points[i].external, 0.9);
    EXPECT_EQ(planned.plan.moves[i].joints.size(), 6);
    expect_reached(free, base, points[i], planned.options.origin + planned.plan.moves[i].tip,
                   planned.plan.moves[i].R.col(2));
  }
  EXPECT_FALSE(planned.plan.branch.empty());
}

/// As the machine moves by itself from step to step: there it stands where `follows` has it.
TEST(ExternalAxis, FollowsAsInACorrection) {
  const SerialArm arm = kuka_on_rail();
  post::PlanOptions options;
  const Planned follows = plan_of(arm, long_part(1500), options, Dialect::krl);
  options.external = External::linear;
  const Planned linear = plan_of(arm, long_part(1500), options, Dialect::krl);
  EXPECT_EQ(linear.plan.branch, follows.plan.branch);
  ASSERT_EQ(linear.plan.moves.size(), follows.plan.moves.size());
  for (std::size_t i = 0; i < linear.plan.moves.size(); ++i) {
    if (linear.plan.moves[i].inserted) continue;
    EXPECT_LT((linear.plan.moves[i].joints - follows.plan.moves[i].joints).cwiseAbs().maxCoeff(), 1e-6);
  }
}

/// A pose as the carried arm sees it, against forward kinematics of the whole.
TEST(CarriedArmTest, SeesThePose) {
  for (const bool turns : {false, true}) {
    for (const auto convention : {machine::DhConvention::modified, machine::DhConvention::standard}) {
      SerialArm arm = kuka_on_rail();
      arm.convention = convention;
      arm.X_MB = {rotation_abc(0.3, -0.4, 0.2), Vec3(0.1, 0.2, 0.3)};
      machine::DhRow& row = arm.dh.front();
      row.kind = turns ? machine::JointKind::revolute : machine::JointKind::prismatic;
      row.a = 0.2;
      row.alpha = 0.4;
      row.d = 0.1;
      row.sign = -1;
      JointVector q(7);
      q << 0.7, 0.1, -1.2, 1.4, 0.3, 0.8, -0.5;
      const Pose X = machine::forward(arm, q);
      const CarriedArm carried = *CarriedArm::of(arm);
      const Pose seen = carried.seen(X, q[0]);
      const Pose inner = machine::forward(carried.arm(), q.tail(6));
      EXPECT_LT((seen.p - inner.p).norm(), 1e-12);
      EXPECT_LT((seen.R - inner.R).norm(), 1e-12);
    }
  }
}

}  // namespace
}  // namespace polypod
