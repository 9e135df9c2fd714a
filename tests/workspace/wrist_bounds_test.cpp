// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The proven workspaces of wrists on modules of legs. Oracle: the inverse, pose by pose.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <string>

#include "../families/stages/bounds.hpp"
#include "machines.hpp"
#include "planes.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/families.hpp"
#include "polypod/workspace/shape.hpp"

namespace polypod::workspace {
namespace {

struct Random {
  std::mt19937_64 engine;
  double operator()(double low, double high) { return std::uniform_real_distribution<double>(low, high)(engine); }
};

machine::Stages read(const std::string& text) {
  const auto m = machine::from_text(text, "t.toml", {});
  if (!m) throw std::runtime_error(to_string(m.error()));
  return std::get<machine::Stages>(*m);
}

/// A Tricept with two joints, the second within these ends.
machine::Stages with_swivel(double low, double high) {
  std::string text = machine::to_toml(machine::load("tricept-wrist").value());
  const std::string from = "min_deg = -120, max_deg = 120";
  text.replace(text.find(from), from.size(), fmt::format("min_deg = {}, max_deg = {}", low, high));
  return read(text);
}

/// An Exechon whose own tool must stay above a plane, mounted aslant, with two joints 50 deg apart and a tool axis that
/// is 70 deg off the second; joint 1 has ends.
constexpr const char* kOblique = R"(
family = "stages"
task = "axis"
limits = { x_max_mm = 250 }
[[stage]]
machine = "exechon"
mount = { z_mm = 1900, a_deg = 165, b_deg = 10, c_deg = 20 }
[[stage]]
mount = { x_mm = 15, z_mm = 40, b_deg = 5 }
home = [20, 60]
[stage.machine]
family = "serial"
dh = [ { d_mm = 60, alpha_deg = 50 }, { alpha_deg = 70, theta_offset_deg = 10 } ]
tool = { z_mm = 150, a_deg = 180 }
limits = [ { min_deg = -100, max_deg = 140 }, { min_deg = -170, max_deg = 95 } ]
)";

/// Three joints that meet, and a tool beside the last axis.
constexpr const char* kThree = R"(
family = "stages"
task = "pose"
[[stage]]
machine = "tricept"
mount = { z_mm = 1900, a_deg = 180 }
[[stage]]
home = [0, 60, 0]
[stage.machine]
family = "serial"
dh = [ { d_mm = 100, alpha_deg = 90 }, { alpha_deg = -90 }, { d_mm = 60 } ]
tool = { x_mm = 40, z_mm = 150, a_deg = 160 }
limits = [ { min_deg = -360, max_deg = 360 }, { min_deg = -35, max_deg = 60 }, { min_deg = -180, max_deg = 180 } ]
)";

/// Two joints 45 deg apart (a nutating head), on a Tricept.
constexpr const char* kNutating = R"(
family = "stages"
task = "axis"
[[stage]]
machine = "tricept"
mount = { z_mm = 1900, a_deg = 180 }
[[stage]]
home = [0, 60]
[stage.machine]
family = "serial"
dh = [ { d_mm = 120, alpha_deg = 45 }, { alpha_deg = -45 } ]
tool = { z_mm = 250, a_deg = 180 }
limits = [ { min_deg = -200, max_deg = 200 }, { min_deg = -170, max_deg = 170 } ]
)";

/// By how much the best solution keeps its limits, rad or m; -1 where there is none.
double margin_of(const machine::Stages& m, const Pose& X) {
  const std::vector<double> p = kinematics::nominal_parameters(m);
  const auto first_of_wrist = kinematics::limit_table(m.machines[0]).size();
  double best = -1;
  for (const kinematics::Solution& s : machine::inverse(m, X).solutions) {
    const std::span<const double> q(s.joints.data(), static_cast<std::size_t>(s.joints.size()));
    const std::vector<double> g = limits<double>(m, settled(m, X, s.joints), q, p);
    double least = 1;
    for (std::size_t i = 0; i < g.size(); ++i) {
      const bool of_wrist = i >= first_of_wrist && i < first_of_wrist + 2 * static_cast<std::size_t>(m.data[1].joints);
      const int joint = static_cast<int>((i - first_of_wrist) / 2);
      if (of_wrist && WristLimits::turns_round(kinematics::joint_range(m.machines[1], joint))) continue;
      least = std::min(least, g[i]);
    }
    best = std::max(best, least);
  }
  return best;
}

Mat3 orientation_in(const Patch& patch, double s, double t) {
  const double u = patch.low[0] + s * (patch.high[0] - patch.low[0]),
               v = patch.low[1] + t * (patch.high[1] - patch.low[1]);
  if (patch.sector) return rotation_of(u * Vec3(-std::sin(v), std::cos(v), 0));
  return rotation_y(v) * rotation_x(u);
}

/// The least margin over the patch, from a grid and a descent from its best place.
double least_margin(const machine::Stages& m, const Patch& patch, const Vec3& p) {
  constexpr int kSteps = 2;
  double best = std::numeric_limits<double>::infinity(), s = 0, t = 0;
  const auto look = [&](double u, double v) {
    const double margin = margin_of(m, {orientation_in(patch, u, v), p});
    if (!(margin < best)) return false;
    best = margin;
    s = u;
    t = v;
    return true;
  };
  for (int i = 0; i <= kSteps; ++i)
    for (int j = 0; j <= kSteps; ++j) look(double(i) / kSteps, double(j) / kSteps);
  for (double step = 1.0 / kSteps; step > 1e-6 && best >= 0;) {
    bool better = false;
    for (const auto& [u, v] : {std::pair{1, 0}, std::pair{-1, 0}, std::pair{0, 1}, std::pair{0, -1}})
      better = look(std::clamp(s + u * step, 0.0, 1.0), std::clamp(t + v * step, 0.0, 1.0)) || better;
    if (!better) step *= 0.5;
  }
  return best;
}

std::vector<machine::Stages> wrists() {
  return {with_swivel(-120, 120), with_swivel(5, 40), with_swivel(-20, 32),
          read(kOblique),         read(kThree),       read(kNutating)};
}

class EachWrist : public ::testing::TestWithParam<std::size_t> {};
INSTANTIATE_TEST_SUITE_P(WristBounds, EachWrist, ::testing::Range<std::size_t>(0, 6));

TEST_P(EachWrist, PlanesHoldOnBothSides) {
  const machine::Stages m = wrists()[GetParam()];
  const auto limits = bounds_of(m, Options{});
  ASSERT_TRUE(limits) << to_string(limits.error());
  Vec3 low, high;
  limits->box(low, high, {});
  Random random{std::mt19937_64(GetParam() + 1)};
  test::PlanesSeen seen;
  for (int cell = 0; cell < 400; ++cell) {
    const double size = std::pow(10.0, random(-3.5, -1.2)), width = size * random(0, 2);
    const Vec3 half(size, size * random(0.3, 1), size * random(0.3, 1));
    Patch patch;
    if (cell % 2 == 0) {
      const double a = random(-0.5, 0.5), b = random(-0.5, 0.5);
      patch = make_rectangle({a, b}, {a + width, b + width * random(0, 1)});
    } else {
      const double radius = random(0, 0.6), azimuth = random(0, 6);
      patch = make_sector({radius, azimuth}, {radius + width, azimuth + std::min(1.5, width / (radius + width))});
    }
    Vec3 center;
    double best = 10;
    for (int t = 0; t < 40; ++t) {
      const Vec3 p(random(low.x(), high.x()), random(low.y(), high.y()), random(low.z(), high.z()));
      if (const double margin = std::abs(margin_of(m, {orientation_in(patch, 0.5, 0.5), p})); margin < best) {
        best = margin;
        center = p;
      }
    }
    constexpr double kNearZero = 1e-8;
    test::expect_planes_hold(
        *limits, center, half, patch, random, kNearZero, cell, [&](const Vec3& p) { return least_margin(m, patch, p); },
        [&](const Vec3& p) {
          return margin_of(m, {orientation_in(patch, random(0, 1), random(0, 1)), p});
        },
        seen);
  }
  EXPECT_GT(seen.undecided(), 10);
  EXPECT_GT(seen.kept, 50);
  EXPECT_GT(seen.lost, 50);
}

// The share of random points that the inverse reaches lies between the bounds, with four standard deviations of it.
TEST_P(EachWrist, HoldAMonteCarlo) {
  const machine::Stages m = wrists()[GetParam()];
  Options options;
  options.relative_tolerance = 0.05;
  const auto v = volume(AnyMachine(m), options);
  ASSERT_TRUE(v) << to_string(v.error());
  ASSERT_TRUE(v->proven && v->converged) << v->lower << " " << v->upper;
  Random random{std::mt19937_64(9)};
  constexpr int kCount = 40'000;
  int reached = 0;
  for (int k = 0; k < kCount; ++k) {
    Vec3 p;
    for (int i = 0; i < 3; ++i) p[i] = random(v->min[i], v->max[i]);
    reached += machine::inverse(m, Pose{Mat3::Identity(), p}).reachable() != nullptr ? 1 : 0;
  }
  const double box = (v->max - v->min).prod(), share = double(reached) / kCount;
  const double spread = 4 * box * std::sqrt(share * (1 - share) / kCount);
  EXPECT_GE(box * share, v->lower - spread);
  EXPECT_LE(box * share, v->upper + spread);
}

// About the straight wrist, where the reach of oblique axes ends at an angle of 0.
TEST(WristBounds, HoldABoxAboutTheStraightWrist) {
  const AnyMachine m(read(kNutating));
  const Shape box{ShapeKind::box, Vec3(0, 0, 0.315), Vec3(0.02, 0.02, 0.015)};
  EXPECT_TRUE(certainly_holds(m, {}, box, 100'000).value());
  Options tilted;
  tilted.directions.tilt = units::from_deg(20);
  const Shape wide{ShapeKind::box, Vec3(0, 0, 0.375), Vec3(0.2, 0.2, 0.075)};
  EXPECT_TRUE(certainly_holds(m, tilted, wide, 100'000).value());
}

TEST(WristBounds, AnUnprovenWristSaysSo) {
  // A third joint with ends is not followed.
  std::string text = kThree;
  const std::string from = "min_deg = -180, max_deg = 180";
  text.replace(text.find(from), from.size(), "min_deg = -170, max_deg = 170");
  const AnyMachine m(read(text));
  EXPECT_FALSE(has_bounds(m));
  EXPECT_TRUE(has_bounds(AnyMachine(read(kThree))));
  const Shape cube{ShapeKind::box, Vec3(0, 0, 0.5), Vec3::Constant(0.01)};
  EXPECT_EQ(certainly_holds(m, {}, cube, 1000).error().id, "WS102");
}

}  // namespace
}  // namespace polypod::workspace
