// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What must hold for every machine of the catalogue, asked only through the questions that every machine answers.
#include <gtest/gtest.h>

#include <limits>
#include <numbers>
#include <random>

#include "kinematics/invariants.hpp"
#include "machines.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/families.hpp"
#include "polypod/kinematics/hold.hpp"

namespace polypod {
namespace {

using kinematics::JointVector;
using machine::AnyMachine;

/// The solution whose joints are nearest to q.
const kinematics::Solution* nearest(const kinematics::InverseResult& result, const JointVector& q) {
  const kinematics::Solution* best = nullptr;
  for (const kinematics::Solution& s : result.solutions)
    if (best == nullptr || (s.joints - q).norm() < (best->joints - q).norm()) best = &s;
  return best;
}

/// A pose and joints that belong together: random joints of a serial arm; of other machines home moved by up to
/// `share` of the distance of the platform joints in each coordinate of the task.
struct Standing {
  Pose X_MT;
  JointVector q;
};
std::optional<Standing> standing(const AnyMachine& m, std::mt19937& random, double share) {
  std::uniform_real_distribution<double> unit(-1, 1);
  const auto home = kinematics::home_pose(m);
  if (!home) {
    JointVector q(kinematics::joint_count(m));
    for (int i = 0; i < q.size(); ++i) {
      const auto range = kinematics::joint_range(m, i);
      // Of a range of several turns the turn round its middle, which is the one that the inverse names.
      const bool turns = kinematics::joint_kind(m, i) == kinematics::JointKind::revolute;
      const double width = range.max - range.min, most = turns ? std::min(width, 2 * std::numbers::pi) : width;
      q[i] = 0.5 * (range.min + range.max) + 0.4 * share / 0.1 * unit(random) * most;
    }
    return Standing{kinematics::forward(m, q).poses.at(0), q};
  }
  const machine::Task task = kinematics::task(m);
  const auto at_home = kinematics::inverse(m, *home);
  if (at_home.solutions.empty()) return {};
  const double L = kinematics::dexterity(m, *home, at_home.solutions[0].joints).characteristic_length;
  std::vector<double> c = kinematics::coordinates_of(task, *home);
  for (int i = 0; i < task.size(); ++i) {
    c[static_cast<std::size_t>(i)] += share * unit(random) * (task.is_angle(i) ? 1.0 : std::min(L, 0.5));
  }
  const Pose X = kinematics::pose_of(task, c);
  const auto result = kinematics::inverse(m, X);
  if (result.solutions.empty()) return {};
  return Standing{kinematics::settled(m, X, result.solutions[0].joints), result.solutions[0].joints};
}

/// `step` of the differences along each coordinate; they agree with derivatives to `close`.
void check(const AnyMachine& any, const Standing& at, double step = 1e-5, double close = 1e-4) {
  const machine::Task task = kinematics::task(any);
  const Pose X = kinematics::settled(any, at.X_MT, at.q);
  EXPECT_LT((X.p - at.X_MT.p).norm() + (X.R - at.X_MT.R).norm(), 1e-9) << "settled poses settle where they are";

  // The closure vanishes there; limits on intervals hold those on numbers.
  std::visit(
      [&](const auto& m) {
        const std::vector<double> p = kinematics::nominal_parameters(m);
        const std::vector<machine::Parameter> named = parameters(m);
        ASSERT_EQ(p.size(), named.size());
        for (std::size_t k = 0; k < p.size(); ++k) EXPECT_EQ(p[k], named[k].value) << named[k].key;
        const std::span<const double> q(at.q.data(), static_cast<std::size_t>(at.q.size()));
        EXPECT_LT(closure(m, X, q, std::span<const double>(p)).cwiseAbs().maxCoeff(), 1e-9);
        const std::vector<Interval> q_box(q.begin(), q.end()), p_box(p.begin(), p.end());
        const auto g = limits(m, X, q, std::span<const double>(p));
        const auto box =
            limits(m, X.cast<Interval>(), std::span<const Interval>(q_box), std::span<const Interval>(p_box));
        ASSERT_EQ(g.size(), box.size());
        ASSERT_LE(g.size(), 64U);
        const testing::BoxNumbers numbers(at.q, p, 0.0);
        const auto first_order = limits(m, X.cast<BoxNumber>(), std::span<const BoxNumber>(numbers.q),
                                        std::span<const BoxNumber>(numbers.p));
        ASSERT_EQ(first_order.size(), g.size());
        for (std::size_t i = 0; i < g.size(); ++i) {
          EXPECT_TRUE(box[i].contains(g[i])) << "limit " << i;
          EXPECT_TRUE(testing::holds(first_order[i], g[i])) << "limit " << i;
          EXPECT_LT(first_order[i].radius(), 1e-6) << "limit " << i;
        }
      },
      any);

  // The joints are among the solutions; what the task prescribes is what the pose has.
  const auto result = kinematics::inverse(any, X);
  const kinematics::Solution* back = nearest(result, at.q);
  ASSERT_NE(back, nullptr);
  EXPECT_LT((back->joints - at.q).cwiseAbs().maxCoeff(), 1e-6);

  // Twists per change of the joints, and the power of drives and tool, by differences along each coordinate.
  const auto J = kinematics::jacobian(any, X, at.q);
  const Vec6 wrench = (Vec6() << 3, -2, 5, 0.4, -0.3, 0.2).finished();
  const std::vector<double> c = kinematics::coordinates_of(task, X);
  for (int i = 0; i < task.size(); ++i) {
    std::array<Standing, 2> moved;
    for (const int side : {0, 1}) {
      std::vector<double> d = c;
      d[static_cast<std::size_t>(i)] += side == 0 ? -step : step;
      const auto there = kinematics::inverse(any, kinematics::pose_of(task, d));
      const kinematics::Solution* s = nearest(there, at.q);
      ASSERT_NE(s, nullptr) << "coordinate " << i;
      moved[static_cast<std::size_t>(side)] = {kinematics::settled(any, kinematics::pose_of(task, d), s->joints),
                                               s->joints};
    }
    Vec6 twist;
    twist << (moved[1].X_MT.p - moved[0].X_MT.p) / (2 * step),
        rotation_vector(moved[1].X_MT.R * moved[0].X_MT.R.transpose()) / (2 * step);
    const JointVector speed = (moved[1].q - moved[0].q) / (2 * step);
    EXPECT_LT((J * speed - twist).norm(), close * (1 + twist.norm() + speed.norm())) << "coordinate " << i;
    EXPECT_NEAR((J.transpose() * wrench).dot(speed), wrench.dot(twist),
                close * (1 + wrench.norm() * (twist.norm() + speed.norm())));
  }
}

TEST(Catalogue, EveryMachineKeepsTheInvariants) {
  for (const machine::CatalogueEntry& entry : machine::catalogue()) {
    SCOPED_TRACE(entry.name);
    const AnyMachine m = test::load(std::string(entry.name));
    std::mt19937 random(20261122);
    int judged = 0;
    for (int k = 0; k < 60 && judged < 25; ++k) {
      SCOPED_TRACE(k);
      const auto at = standing(m, random, k == 0 ? 0.0 : 0.1);
      if (!at) continue;
      // Differences say nothing near singular poses: at a stretched arm a step of 1e-5 m is beyond reach or turns
      // joints by more than its share.
      if (kinematics::dexterity(m, at->X_MT, at->q).condition > (kinematics::home_pose(m) ? 1e4 : 1e2)) continue;
      check(m, *at);
      ++judged;
    }
    EXPECT_GE(judged, 10);
  }
}

TEST(Catalogue, EveryMachineReadsBackWhatItWrites) {
  for (const machine::CatalogueEntry& entry : machine::catalogue()) {
    SCOPED_TRACE(entry.name);
    const AnyMachine m = test::load(std::string(entry.name));
    const std::string text = machine::to_toml(m);
    const auto again = machine::from_text(text, "again.toml");
    ASSERT_TRUE(again.has_value()) << to_string(again.error());
    EXPECT_EQ(machine::to_toml(*again), text);
    const auto a = kinematics::parameters(m), b = kinematics::parameters(*again);
    ASSERT_EQ(a.size(), b.size());
    for (std::size_t i = 0; i < a.size(); ++i) EXPECT_NEAR(a[i].value, b[i].value, 1e-11) << a[i].key;
  }
}

/// A pose close to a singular one: from where a machine stands in a random direction until the condition is 200 (40
/// where the inverse is a search), or until what separates it from there is passed (the border of reach, a determinant
/// of the other sign), close to which it is as large. None where neither comes within half a turn or 1.5 m.
std::optional<Standing> near_singular(const AnyMachine& m, std::mt19937& random) {
  // Searches of the inverse lose the solutions closer to the border of reach.
  const double most = kinematics::searches(m) ? 40 : 200;
  std::uniform_real_distribution<double> unit(-1, 1);
  const auto start = standing(m, random, 0.05);
  if (!start) return {};
  const machine::Task task = kinematics::task(m);
  const bool by_joints = !kinematics::home_pose(m);
  std::vector<double> from =
      by_joints ? std::vector<double>(start->q.begin(), start->q.end()) : kinematics::coordinates_of(task, start->X_MT);
  std::vector<double> along(from.size());
  for (double& d : along) d = unit(random);
  const auto at = [&](double s, const JointVector& near) -> std::optional<Standing> {
    std::vector<double> c = from;
    for (std::size_t i = 0; i < c.size(); ++i) c[i] += s * along[i];
    if (by_joints) {
      const JointVector q = Eigen::Map<const Eigen::VectorXd>(c.data(), static_cast<Eigen::Index>(c.size()));
      return Standing{kinematics::forward(m, q).poses.at(0), q};
    }
    const Pose X = kinematics::pose_of(task, c);
    const auto result = kinematics::inverse(m, X);
    const kinematics::Solution* s_near = nearest(result, near);
    if (s_near == nullptr) return {};
    return Standing{kinematics::settled(m, X, s_near->joints), s_near->joints};
  };
  const auto side = [&](const Standing& there) {
    return kinematics::is_serial(m) ? kinematics::dexterity(m, there.X_MT, there.q).determinant < 0
                                    : kinematics::hold(m, there.X_MT, there.q).determinant < 0;
  };
  const bool side_before = side(*start);
  double in = 0, out = 0;
  Standing last = *start;
  const auto is_on_this_side = [&](double s) {
    const auto there = at(s, last.q);
    if (!there) return false;
    if (!(kinematics::dexterity(m, there->X_MT, there->q).condition < most) || side(*there) != side_before)
      return false;
    last = *there;
    return true;
  };
  constexpr double kStep = 0.02, kFar = 1.5;
  for (double s = kStep; out == 0 && s < kFar; s += kStep) (is_on_this_side(s) ? in : out) = s;
  if (in == 0 || out == 0) return {};
  for (int k = 0; k < 60; ++k) {
    const double middle = 0.5 * (in + out);
    (is_on_this_side(middle) ? in : out) = middle;
  }
  if (kinematics::dexterity(m, last.X_MT, last.q).condition < 0.5 * most) return {};
  return last;
}

// By differences of steps that are small beside the way to the singular pose.
TEST(Catalogue, InvariantsHoldNearSingularPoses) {
  std::string without;
  for (const machine::CatalogueEntry& entry : machine::catalogue()) {
    SCOPED_TRACE(entry.name);
    const AnyMachine m = test::load(std::string(entry.name));
    std::mt19937 random(20261127);
    int judged = 0;
    for (int k = 0; k < 60 && judged < 3; ++k) {
      SCOPED_TRACE(k);
      const auto at = near_singular(m, random);
      if (!at) continue;
      check(m, *at, 3e-7, 3e-3);
      ++judged;
    }
    if (judged == 0) without += std::string(entry.name) + " ";
  }
  EXPECT_EQ(without, "");
}

// The hold of many poses is that of each: the same determinant but for L, whose sign it does not change; `control`
// exact below what is asked for, and else never above.
TEST(Hold, AtManyPosesIsTheHoldOfEach) {
  std::mt19937 random(5);
  int bounds = 0;
  for (const machine::CatalogueEntry& entry : machine::catalogue()) {
    SCOPED_TRACE(entry.name);
    const AnyMachine m = test::load(std::string(entry.name));
    if (kinematics::is_serial(m)) continue;
    const kinematics::HoldAnywhere anywhere(m);
    for (int k = 0; k < 20; ++k) {
      const auto at = standing(m, random, 0.1);
      if (!at) continue;
      const Pose X = kinematics::settled(m, at->X_MT, at->q);
      const kinematics::Hold each = kinematics::hold(m, X, at->q);
      const kinematics::Hold exact = anywhere.at(X, at->q, std::numeric_limits<double>::infinity());
      const kinematics::Hold asked = anywhere.at(X, at->q);
      EXPECT_EQ(asked.determinant, exact.determinant);
      EXPECT_EQ(std::signbit(each.determinant), std::signbit(exact.determinant));
      EXPECT_LE(asked.control, exact.control * (1 + 1e-9));
      if (asked.control < kinematics::kLittleHold || each.determinant == 0) {
        EXPECT_EQ(asked.control, exact.control);
      }
      bounds += asked.control < exact.control;
    }
    const auto home = kinematics::home_pose(m);
    ASSERT_TRUE(home.has_value());
    const JointVector q = kinematics::inverse(m, *home).solutions.at(0).joints;
    const kinematics::Hold each = kinematics::hold(m, *home, q);
    const kinematics::Hold there =
        anywhere.at(kinematics::settled(m, *home, q), q, std::numeric_limits<double>::infinity());
    EXPECT_NEAR(there.determinant, each.determinant, 1e-9 * std::abs(each.determinant));
    EXPECT_NEAR(there.control, each.control, 1e-9);
  }
  EXPECT_GT(bounds, 100);
}

// What forward kinematics gives closes, of every machine and with any joints in their ranges.
TEST(Forward, EveryPoseClosesWithTheJointsThatWereAsked) {
  std::mt19937 random(4);
  for (const machine::CatalogueEntry& entry : machine::catalogue()) {
    SCOPED_TRACE(entry.name);
    const AnyMachine any = test::load(std::string(entry.name));
    int found = 0;
    for (int k = 0; k < 60; ++k) {
      JointVector q(kinematics::joint_count(any));
      for (int i = 0; i < q.size(); ++i) {
        const auto range = kinematics::joint_range(any, i);
        q[i] = std::uniform_real_distribution<double>(range.min, range.max)(random);
      }
      for (const Pose& X : kinematics::forward(any, q).poses) {
        ++found;
        const double residual = std::visit([&](const auto& m) { return kinematics::closure_residual(m, X, q); }, any);
        EXPECT_LT(residual, 1e-8) << q.transpose();
      }
    }
    EXPECT_GT(found, 0);
  }
}

// A figure that a machine changes when it is set (a direction becomes a unit vector) is held by a rule: else a
// calibration finds parameters that no machine has.
TEST(Parameters, WhatAMachineChangesARuleHolds) {
  constexpr double kMoved = 1e-4;
  for (const machine::CatalogueEntry& entry : machine::catalogue()) {
    SCOPED_TRACE(entry.name);
    const AnyMachine any = test::load(std::string(entry.name));
    std::vector<double> p;
    for (const auto& parameter : kinematics::parameters(any)) p.push_back(parameter.value);
    const auto rules = [&](const std::vector<double>& at) {
      return std::visit([&](const auto& m) { return kinematics::rules_of(m, std::span<const double>(at)); }, any);
    };
    for (const double rule : rules(p)) EXPECT_NEAR(rule, 0, 1e-9);
    for (std::size_t i = 0; i < p.size(); ++i) {
      std::vector<double> moved = p;
      moved[i] += kMoved;
      const auto other = machine::with_parameters(any, moved);
      if (!other) continue;  // beyond what the machine takes
      double changed = 0, told = 0;
      const auto has = kinematics::parameters(*other);
      for (std::size_t k = 0; k < p.size(); ++k) changed = std::max(changed, std::abs(has[k].value - moved[k]));
      for (const double rule : rules(moved)) told = std::max(told, std::abs(rule));
      // To first order a unit vector keeps what is square to it.
      if (changed > 0.01 * kMoved) {
        EXPECT_GT(told, 0.5 * changed) << kinematics::parameters(any)[i].key;
      }
    }
  }
}

}  // namespace
}  // namespace polypod
