// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The proven workspaces of arms on rails and of SCARA robots. Oracles: the closed inverse of the arm at many places of
// the rail, and closed forms.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <string>

#include "../families/serial/bounds.hpp"
#include "../families/serial/judge.hpp"
#include "margin.hpp"
#include "planes.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/workspace/shape.hpp"

namespace polypod::workspace {
namespace {

struct Random {
  std::mt19937_64 engine;
  double operator()(double low, double high) { return std::uniform_real_distribution<double>(low, high)(engine); }
};

machine::SerialArm arm_of(const std::string& text) {
  const auto m = machine::from_text(text, "t.toml", {});
  if (!m) throw std::runtime_error(to_string(m.error()));
  return std::get<machine::SerialArm>(*m);
}

/// A KUKA with a spindle across its flange on 3 m of rail along x of M.
machine::SerialArm robot_on_a_rail() {
  auto arm = std::get<machine::SerialArm>(*machine::load("kuka-kr210"));
  arm.X_FT = arm.X_FT * Pose{rotation_y(units::from_deg(90)), {0.3, 0, -0.2}};
  machine::DhRow rail;
  rail.kind = machine::JointKind::prismatic;
  rail.theta_offset = units::from_deg(90);
  rail.range = {-1, 2};
  arm.dh.front().alpha = units::from_deg(-90);
  arm.dh.insert(arm.dh.begin(), rail);
  arm.X_MB = {rotation_y(units::from_deg(90)), Vec3::Zero()};
  return arm;
}
/// Five joints on a rail that rises.
machine::SerialArm five_on_a_rail() {
  auto arm = std::get<machine::SerialArm>(*machine::load("lola50"));
  machine::DhRow rail;
  rail.kind = machine::JointKind::prismatic;
  rail.range = {0, 0.8};
  arm.dh.insert(arm.dh.begin(), rail);
  const Mat3 R = rotation_y(0.4);
  arm.X_MB = {R, arm.X_MB.p};
  return arm;
}

constexpr const char* kScara = R"(
family = "serial"
task = ["x", "y", "z", "C"]
base = { x_mm = 30, y_mm = -20, c_deg = 25 }
dh = [ { a_mm = 300, d_mm = 400 }, { a_mm = 250, alpha_deg = 180 }, { joint = "prismatic" }, { d_mm = 50, theta_offset_deg = 10 } ]
tool = { x_mm = 40, y_mm = 15, a_deg = 180, c_deg = 20 }
limits = [ {min_deg=-130,max_deg=130}, {min_deg=-145,max_deg=100}, {min_mm=0,max_mm=180}, {min_deg=-120,max_deg=150} ]
)";
// The slide first (a column), senses exchanged, links off each other's line at 0, a locked row.
constexpr const char* kColumn = R"(
family = "serial"
convention = "modified"
task = ["x", "y", "z", "C"]
dh = [ { joint = "prismatic", sign = -1 }, { sign = -1, theta_offset_deg = 40 }, { a_mm = 325, d_mm = 20 },
       { a_mm = 275, theta_offset_deg = -70, sign = -1 }, { a_mm = 10, alpha_deg = 15 } ]
locked = { 5 = 12 }
tool = { z_mm = 100, a_deg = 30 }
limits = [ {min_mm=-900,max_mm=0}, {min_deg=-100,max_deg=170}, {min_deg=-150,max_deg=150}, {min_deg=-90,max_deg=200}, {min_deg=0,max_deg=20} ]
)";

/// By how much the best branch keeps the joint limits, rad or m; -1 where there is none.
double margin_of(const machine::SerialArm& arm, const Pose& X) {
  double best = -1;
  for (const kinematics::Solution& s : machine::inverse(arm, X).solutions) {
    double least = 1;
    Eigen::Index next = 0;
    for (const machine::DhRow& row : arm.dh) {
      if (row.locked) continue;
      const double q = s.joints[next++];
      const bool turns = row.kind == machine::JointKind::revolute;
      if (turns && row.range.max - row.range.min >= 2 * std::numbers::pi - 1e-9) continue;
      least = std::min({least, q - row.range.min, row.range.max - q});
    }
    best = std::max(best, least);
  }
  return best;
}

/// The best of the u of a range: a fine grid, and the golden section beside its best. `seen(u)`: what the arm sees.
template <class Seen>
double best_margin(const machine::SerialArm& arm, const machine::JointRange& range, const Seen& seen) {
  constexpr int kSteps = 1500;
  const auto at = [&](double u) { return margin_of(arm, seen(u)); };
  const double step = (range.max - range.min) / kSteps;
  double best = -1, where = range.min;
  for (int k = 0; k <= kSteps; ++k) {
    const double u = range.min + k * step, margin = at(u);
    if (margin > best) where = u;
    best = std::max(best, margin);
  }
  double a = std::max(range.min, where - step), b = std::min(range.max, where + step);
  for (int i = 0; i < 60; ++i) {
    const double c = b - 0.618 * (b - a), d = a + 0.618 * (b - a), at_c = at(c), at_d = at(d);
    best = std::max({best, at_c, at_d});
    (at_c > at_d ? b : a) = at_c > at_d ? d : c;
  }
  return best;
}

Patch one_direction() {
  return whole_patch(Directions{});
}

template <class Margin>
void expect_planes(const machine::SerialArm& arm, int cells, int least, const Margin& margin) {
  const auto bounds = bounds_of(arm, Options{});
  ASSERT_TRUE(bounds);
  std::visit(
      [&](const auto& limits) {
        Vec3 low, high;
        limits.box(low, high, {});
        Random random{std::mt19937_64(5)};
        test::PlanesSeen seen;
        for (int cell = 0; cell < cells; ++cell) {
          const double size = std::pow(10.0, random(-2.5, -1));
          const Vec3 half(size, size * random(0.3, 1), size * random(0.3, 1));
          Vec3 center;
          double best = 10;
          for (int t = 0; t < 10; ++t) {
            const Vec3 p(random(low.x(), high.x()), random(low.y(), high.y()), random(low.z(), high.z()));
            if (const double m = std::abs(margin(p)); m < best) {
              best = m;
              center = p;
            }
          }
          test::expect_planes_hold(limits, center, half, one_direction(), random, 1e-7, cell, margin, margin, seen);
        }
        EXPECT_GE(seen.undecided(), least);
        EXPECT_GT(seen.kept, cells / 10);
        EXPECT_GT(seen.lost, cells / 10);
      },
      *bounds);
}

TEST(RailBounds, PlanesHoldOnBothSides) {
  for (const machine::SerialArm& arm : {robot_on_a_rail(), five_on_a_rail()}) {
    const auto carried = machine::CarriedArm::of(arm);
    ASSERT_TRUE(carried);
    expect_planes(arm, 120, 12, [&](const Vec3& p) {
      return best_margin(carried->arm(), carried->range(), [&](double u) {
        return carried->seen({Mat3::Identity(), p}, u);
      });
    });
  }
}

/// What the arm sees from any u of a piece, of any tip in the box, lies in what `seen` says.
TEST(OneMore, WhatIsSeenFromAPieceHoldsWhatIsSeenFromEachOfIts) {
  Random random{std::mt19937_64(3)};
  const auto vector = [&](double size) { return Vec3(random(-size, size), random(-size, size), random(-size, size)); };
  for (int trial = 0; trial < 3000; ++trial) {
    OneMore more;
    more.kind = static_cast<OneMore::Kind>(trial % 3);
    more.axis = more.kind == OneMore::Kind::rail ? vector(1) : vector(1).normalized();
    more.point = vector(1);
    const Vec3 center = vector(2), half = vector(0.2).cwiseAbs();
    const double u = random(-3, 3), w = random(0, 0.8);
    const Patch patch = one_direction();
    const OneMore::Seen seen = more.seen(center, half, patch, u, w);
    for (int k = 0; k < 10; ++k) {
      const Vec3 x = half.cwiseProduct(vector(1));
      const double at = u + 0.5 * w * (k < 2 ? 2 * k - 1 : random(-1, 1));
      Pose X{Mat3::Identity(), center + x};
      if (more.kind == OneMore::Kind::rail) {
        X.p -= at * more.axis;
      } else if (more.kind == OneMore::Kind::spin) {
        X.R = rotation_z(at);
      } else {
        const Mat3 back = Eigen::AngleAxisd(-at, more.axis).toRotationMatrix();
        X = {back, more.point + back * (X.p - more.point)};
      }
      EXPECT_TRUE(((X.p - seen.center).cwiseAbs().array() <= seen.half.array() + 1e-12).all()) << trial;
      const Vec3 G = vector(1), off = X.p - seen.center - seen.turn * x, b = vector(1);
      EXPECT_LE(std::abs(G.dot(off)), std::abs(G.dot(seen.along)) + G.norm() * seen.round + 1e-12) << trial;
      EXPECT_LE((X.R * b - seen.patch.R * b).norm(), seen.patch.bend * b.norm() + 1e-12) << trial;
    }
  }
}

TEST(ScaraBounds, PlanesHoldOnBothSides) {
  for (const char* text : {kScara, kColumn}) {
    const machine::SerialArm arm = arm_of(text);
    expect_planes(arm, 1500, 150, [&](const Vec3& p) { return margin_of(arm, {Mat3::Identity(), p}); });
  }
}

TEST(ScaraBounds, TheVolumeOfARingIsThatOfItsClosedForm) {
  std::string text = kScara;
  for (const auto& [from, to] : {std::pair{"min_deg=-130,max_deg=130", "min_deg=-180,max_deg=180"},
                                 std::pair{"min_deg=-145,max_deg=100", "min_deg=-180,max_deg=180"},
                                 std::pair{"min_deg=-120,max_deg=150", "min_deg=-180,max_deg=180"}})
    text.replace(text.find(from), std::string(from).size(), to);
  Options options;
  options.relative_tolerance = 1e-3;
  const auto v = volume(AnyMachine(arm_of(text)), options);
  ASSERT_TRUE(v) << to_string(v.error());
  EXPECT_TRUE(v->proven);
  EXPECT_TRUE(v->converged);
  const double ring = std::numbers::pi * (0.55 * 0.55 - 0.05 * 0.05) * 0.18;
  EXPECT_LE(v->lower, ring);
  EXPECT_GE(v->upper, ring);
}

// The share of random points that the inverse reaches lies between the bounds, with four standard deviations of it.
TEST(ScaraBounds, HoldAMonteCarlo) {
  for (const char* text : {kScara, kColumn}) {
    const machine::SerialArm arm = arm_of(text);
    Options options;
    options.relative_tolerance = 0.01;
    const auto v = volume(AnyMachine(arm), options);
    ASSERT_TRUE(v) << to_string(v.error());
    ASSERT_TRUE(v->proven && v->converged);
    Random random{std::mt19937_64(9)};
    constexpr int kCount = 200'000;
    int reached = 0;
    for (int k = 0; k < kCount; ++k) {
      Vec3 p;
      for (int i = 0; i < 3; ++i) p[i] = random(v->min[i], v->max[i]);
      reached += machine::inverse(arm, Pose{Mat3::Identity(), p}).reachable() != nullptr ? 1 : 0;
    }
    const double box = (v->max - v->min).prod(), share = double(reached) / kCount;
    const double spread = 4 * box * std::sqrt(share * (1 - share) / kCount);
    EXPECT_GE(box * share, v->lower - spread);
    EXPECT_LE(box * share, v->upper + spread);
  }
}

TEST(TurntableBounds, PlanesHoldOnBothSides) {
  machine::SerialArm arm = robot_on_a_rail();
  arm.X_MB = {rotation_y(0.2), Vec3(0.1, 0, 0)};
  arm.dh[0] = {};
  arm.dh[0].range = {-1, 0.8};
  arm.dh[1].alpha = 0;
  arm.dh[1].a = 0.6;
  const auto carried = machine::CarriedArm::of(arm);
  ASSERT_TRUE(carried);
  expect_planes(arm, 100, 1, [&](const Vec3& p) {
    return best_margin(carried->arm(), carried->range(), [&](double u) {
      return carried->seen({Mat3::Identity(), p}, u);
    });
  });
}

TEST(FreeTurnBounds, PlanesHoldOnBothSides) {
  for (const char* name : {"kuka-kr210", "ur10e"}) {
    auto arm = std::get<machine::SerialArm>(*machine::load(name));
    arm.X_FT = arm.X_FT * Pose{rotation_y(units::from_deg(90)), {0.3, 0, -0.2}};
    const machine::SerialArm pose = arm;
    arm.task = machine::Task::axis;
    expect_planes(arm, 100, 1, [&](const Vec3& p) {
      return best_margin(pose, {-std::numbers::pi, std::numbers::pi}, [&](double u) { return Pose{rotation_z(u), p}; });
    });
  }
}

// Once the rail is longer than the arm, a longer one adds the arm's silhouette along the rail and no more.
TEST(RailBounds, ALongRailGrowsByTheSilhouette) {
  const auto on_rail = [](double length) {
    machine::SerialArm arm = five_on_a_rail();
    arm.X_MB.R = Mat3::Identity();
    arm.dh[0].range = {0, length};
    Options options;
    options.relative_tolerance = 0.2;
    return volume(AnyMachine(arm), options);
  };
  const auto four = on_rail(4), five = on_rail(5), six = on_rail(6);
  for (const auto* v : {&four, &five, &six}) {
    ASSERT_TRUE(*v) << to_string(v->error());
    EXPECT_TRUE((*v)->proven);
    EXPECT_TRUE((*v)->converged);
  }
  // 2 V_5 = V_4 + V_6
  EXPECT_LE(2 * five->lower, four->upper + six->upper);
  EXPECT_GE(2 * five->upper, four->lower + six->lower);
  EXPECT_NEAR(six->max.z() - five->max.z(), 1, 0.1);
  // Without a limit of the rail nothing ends it.
  Options off;
  off.limits = ~LimitBits{1};
  const auto endless = volume(AnyMachine(robot_on_a_rail()), off);
  ASSERT_FALSE(endless);
  EXPECT_EQ(endless.error().id, "WS108");
}

// Pictures and fields judge pose by pose: the sign of their margin is that of the best u, and none of them leaves the
// judging to a search by Newton's method (two orders slower where nothing is reached).
TEST(RedundantJudge, HasTheSignOfTheBestPlace) {
  const auto expect_signs = [](const machine::SerialArm& arm, const auto& best) {
    const AnyMachine machine(arm);
    ASSERT_TRUE(redundant_judge(arm, Options{}));
    const auto judge = judge_unchecked(machine, Options{}, FieldOptions{});
    const auto bounds = bounds_of(arm, Options{});
    Vec3 low, high;
    std::visit([&](const auto& limits) { limits.box(low, high, {}); }, *bounds);
    Random random{std::mt19937_64(11)};
    const auto point = [&] {
      return Vec3(random(low.x(), high.x()), random(low.y(), high.y()), random(low.z(), high.z()));
    };
    int in = 0, out = 0;
    for (int k = 0; k < 200; ++k) {  // near the border
      Vec3 inside = point(), outside = point();
      if (!(best(inside) > 0 && best(outside) < 0)) continue;
      for (int i = 0; i < 12; ++i) {
        const Vec3 p = 0.5 * (inside + outside);
        const double expected = best(p);
        (expected > 0 ? inside : outside) = p;
        if (std::abs(expected) < 1e-4) continue;
        (expected > 0 ? in : out) += 1;
        const Margin margin = judge->margin(p);
        EXPECT_EQ(margin.value >= 0, expected > 0) << p.transpose() << ", " << margin.value << " for " << expected;
      }
    }
    EXPECT_GT(in, 20);
    EXPECT_GT(out, 20);
  };
  machine::SerialArm table = robot_on_a_rail();
  table.X_MB = {};
  table.dh[0] = {};
  table.dh[0].range = {-1, 0.8};
  table.dh[1].alpha = 0;
  table.dh[1].a = 0.6;
  for (const machine::SerialArm& arm : {robot_on_a_rail(), five_on_a_rail(), table}) {
    const auto carried = machine::CarriedArm::of(arm);
    expect_signs(arm, [&](const Vec3& p) {
      return best_margin(carried->arm(), carried->range(), [&](double u) {
        return carried->seen({Mat3::Identity(), p}, u);
      });
    });
  }
  auto spun = std::get<machine::SerialArm>(*machine::load("kuka-kr210"));
  const machine::SerialArm pose = spun;
  spun.task = machine::Task::axis;
  expect_signs(spun, [&](const Vec3& p) {
    return best_margin(pose, {-std::numbers::pi, std::numbers::pi}, [&](double u) { return Pose{rotation_z(u), p}; });
  });
}

}  // namespace
}  // namespace polypod::workspace
