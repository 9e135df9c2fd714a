// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The proven workspaces of industrial robots with six joints. The oracle is the closed inverse, pose by pose.
#include <gtest/gtest.h>

#include <fmt/format.h>

#include <cstdlib>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "../families/serial/bounds.hpp"
#include "planes.hpp"
#include "polypod/core/parallel.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/workspace/shape.hpp"

namespace polypod::workspace {
namespace {

struct Random {
  std::mt19937_64 engine;
  double operator()(double low, double high) { return std::uniform_real_distribution<double>(low, high)(engine); }
};

struct SixCase {
  std::string name, machine;
  std::vector<std::array<double, 2>> ranges;  ///< deg, of joints 1 to 6; empty: those of the catalogue
  double coupling = 0;                        ///< of joint 3 to joint 2
};

constexpr std::array<double, 2> kWhole{-360, 360};
// Heads on linear axes: one that nods by 45 deg, and one whose axes pass each other and the tool.
constexpr const char* kSwivel = R"(
family = "serial"
task = "axis"
dh = [ {joint="prismatic", alpha_deg=-80}, {joint="prismatic", alpha_deg=-90, theta_offset_deg=-90}, {joint="prismatic"}, {alpha_deg=45}, {alpha_deg=-45} ]
base = { b_deg = 90 }
tool = { z_mm = 200, a_deg = 180 }
limits = [ {min_mm=-500,max_mm=500}, {min_mm=-400,max_mm=400}, {min_mm=-300,max_mm=300}, {min_deg=-150,max_deg=120}, {min_deg=-170,max_deg=60} ]
)";
constexpr const char* kOffsetHead = R"(
family = "serial"
dh = [ {joint="prismatic", alpha_deg=-90}, {joint="prismatic", alpha_deg=-90, theta_offset_deg=-90}, {joint="prismatic"},
       {alpha_deg=70, a_mm=60}, {alpha_deg=-80, a_mm=45, d_mm=30}, {d_mm=40} ]
base = { b_deg = 90 }
tool = { z_mm = 150, x_mm = 25, a_deg = 170 }
limits = [ {min_mm=-500,max_mm=500}, {min_mm=-400,max_mm=400}, {min_mm=-300,max_mm=300}, {min_deg=-150,max_deg=170}, {min_deg=-110,max_deg=100}, {min_deg=-360,max_deg=360} ]
)";
/// What the bounds treat apart: an arm's plane that stands off axis 1 (puma560), ranges beyond and below half a turn,
/// one elbow or both, a wrist that goes through its straight position or not, a joint 6 that stops; three parallel axes
/// (ur10e).
const std::vector<SixCase>& cases() {
  static const std::vector<SixCase> all{
      {"KR 210", "kuka-kr210", {}},
      {"IRB 6700", "abb-irb6700", {}},
      {"TX200", "staubli-tx200", {}},
      {"RV-6SDL", "mitsubishi-rv6sdl", {}},
      {"Puma 560", "puma560", {}},
      {"narrow", "kuka-kr210", {{-60, 80}, {-110, -40}, {20, 130}, {-100, 60}, {10, 100}, {-90, 120}}},
      {"long", "puma560", {{-150, 200}, {-200, 100}, {-220, 60}, {-100, 150}, {-100, 100}, {-170, 160}}},
      {"UR10e", "ur10e", {}},
      {"UR10e, elbow of one side", "ur10e", {kWhole, kWhole, {15, 150}, kWhole, kWhole, kWhole}},
      {"UR10e, elbow of both", "ur10e", {kWhole, kWhole, {-100, 155}, kWhole, kWhole, kWhole}},
      {"gantry with a fork head", "gantry-fork", {}},
      {"gantry with a head that nods", kSwivel, {}},
      {"parallelogram", "abb-irb6700", {}, -1},
      {"coupled the other way",
       "kuka-kr210",
       {{-60, 80}, {-110, -40}, {-60, 130}, {-100, 60}, {10, 100}, {-90, 120}},
       1},
      {"flipped", "abb-irb6700", {{-170, 170}, {-65, 85}, {-180, 70}, {-80, 80}, {-130, -5}, {-60, 60}}},
  };
  return all;
}

machine::SerialArm arm_of(const SixCase& c) {
  const bool is_text = c.machine.find('\n') != std::string::npos;
  auto arm =
      std::get<machine::SerialArm>(is_text ? *machine::from_text(c.machine, "t.toml", {}) : *machine::load(c.machine));
  std::size_t next = 0;
  for (machine::DhRow& row : arm.dh) {
    if (row.locked || c.ranges.empty()) continue;
    row.range = {units::from_deg(c.ranges[next][0]), units::from_deg(c.ranges[next][1])};
    ++next;
  }
  if (c.coupling != 0) {
    arm.dh[2].coupled_back = 1;
    arm.dh[2].coupling = c.coupling;
  }
  return arm;
}

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

Mat3 orientation_in(const Patch& patch, double s, double t) {
  const double u = patch.low[0] + s * (patch.high[0] - patch.low[0]),
               v = patch.low[1] + t * (patch.high[1] - patch.low[1]);
  if (patch.sector) return rotation_of(u * Vec3(-std::sin(v), std::cos(v), 0));
  return rotation_y(v) * rotation_x(u);
}

/// The least margin over the patch, from a grid and a descent from its best place.
double least_margin(const machine::SerialArm& arm, const Patch& patch, const Vec3& p, int steps = 4) {
  double best = std::numeric_limits<double>::infinity(), s = 0, t = 0;
  const auto look = [&](double u, double v) {
    const double m = margin_of(arm, {orientation_in(patch, u, v), p});
    if (!(m < best)) return false;
    best = m;
    s = u;
    t = v;
    return true;
  };
  for (int i = 0; i <= steps; ++i)
    for (int j = 0; j <= steps; ++j) look(double(i) / steps, double(j) / steps);
  for (double step = 1.0 / steps; step > 1e-6 && best >= 0;) {
    bool better = false;
    for (const auto& [u, v] : {std::pair{1, 0}, std::pair{-1, 0}, std::pair{0, 1}, std::pair{0, -1}})
      better = look(std::clamp(s + u * step, 0.0, 1.0), std::clamp(t + v * step, 0.0, 1.0)) || better;
    if (!better) step *= 0.5;
  }
  return best;
}

class EachSixJointArm : public ::testing::TestWithParam<std::size_t> {};
INSTANTIATE_TEST_SUITE_P(SixJointBounds, EachSixJointArm, ::testing::Range<std::size_t>(0, cases().size()));

template <class Limits>
void expect_planes_hold_on_both_sides(const machine::SerialArm& arm, const Limits& limits, int least = 25) {
  Vec3 low, high;
  limits.box(low, high, {});
  // Limits are widened by 1e-12 of their terms, and the inverse counts a joint at its limit as within.
  constexpr double kNearZero = 1e-8;
  Random random{std::mt19937_64(11 + static_cast<std::uint64_t>(arm.dh[0].range.max * 1e3))};
  test::PlanesSeen seen;
  for (int cell = 0; cell < 1500; ++cell) {
    const double size = std::pow(10.0, random(-3.5, -1.2));
    const Vec3 half(size, size * random(0.3, 1), size * random(0.3, 1));
    const double width = size * random(0, 2);
    Patch patch;
    if (cell % 2 == 0) {
      const double a = random(-3, 3), b = random(-1.5, 1.5);
      patch = make_rectangle({a, b}, {a + width, b + width * random(0, 1)});
    } else {
      const double radius = random(0, 1.2), azimuth = random(0, 6);
      patch = make_sector({radius, azimuth}, {radius + width, azimuth + std::min(1.5, width / (radius + width))});
    }
    // Near the border, where the planes are: a pose with a joint at a limit.
    Vec3 center;
    double best = 10;
    for (int t = 0; t < 40; ++t) {
      const Vec3 p(random(low.x(), high.x()), random(low.y(), high.y()), random(low.z(), high.z()));
      const double margin = std::abs(margin_of(arm, {orientation_in(patch, 0.5, 0.5), p}));
      if (margin < best) {
        best = margin;
        center = p;
      }
    }
    test::expect_planes_hold(
        limits, center, half, patch, random, kNearZero, cell,
        [&](const Vec3& p) { return least_margin(arm, patch, p); },
        [&](const Vec3& p) {
          return margin_of(arm, {orientation_in(patch, random(0, 1), random(0, 1)), p});
        },
        seen);
  }
  EXPECT_GT(seen.undecided(), 25);
  EXPECT_GT(seen.kept, least);
  EXPECT_GT(seen.lost, least);
}

TEST_P(EachSixJointArm, PlanesHoldOnBothSides) {
  const SixCase& one = cases()[GetParam()];
  SCOPED_TRACE(one.name);
  const machine::SerialArm arm = arm_of(one);
  std::visit([&](const auto& limits) { expect_planes_hold_on_both_sides(arm, limits); }, *bounds_of(arm, Options{}));
}

// Where the branches carry the tip to different places bounds come from below alone, so that a sample is taken.
TEST(SixJointBounds, PlanesOfAHeadWithOffsetsHold) {
  const machine::SerialArm arm = arm_of({"", kOffsetHead, {}});
  std::visit([&](const auto& limits) { expect_planes_hold_on_both_sides(arm, limits, 0); }, *bounds_of(arm, Options{}));
}

// The share of random points that the inverse reaches lies between the bounds, with four standard deviations of it.
TEST_P(EachSixJointArm, BoundsHoldAMonteCarlo) {
  const SixCase& one = cases()[GetParam()];
  SCOPED_TRACE(one.name);
  const machine::SerialArm arm = arm_of(one);
  Options options;
  options.relative_tolerance = 0.05;
  options.directions.a_range = options.directions.b_range = {0.3, 0.3};
  const auto v = volume(AnyMachine(arm), options);
  ASSERT_TRUE(v) << to_string(v.error());
  ASSERT_TRUE(v->proven);
  EXPECT_TRUE(v->converged);
  ASSERT_GT(v->lower, 0);
  const bool whole = std::getenv("POLYPOD_LONG") != nullptr;
  const std::size_t count = whole ? 10'000'000 : 200'000, at_once = count / 100;
  std::vector<std::size_t> reached(100, 0);
  const Mat3 R = rotation_y(0.3) * rotation_x(0.3);
  for_each_in_rounds(reached.size(), {}, [&](std::size_t part) {
    Random random{std::mt19937_64(1000 * GetParam() + part)};
    for (std::size_t k = 0; k < at_once; ++k) {
      Vec3 p;
      for (int i = 0; i < 3; ++i) p[i] = random(v->min[i], v->max[i]);
      reached[part] += machine::inverse(arm, Pose{R, p}).reachable() != nullptr ? 1 : 0;
    }
  });
  double sum = 0;
  for (const std::size_t r : reached) sum += static_cast<double>(r);
  const double box = (v->max - v->min).prod(), share = sum / static_cast<double>(count);
  const double spread = 4 * box * std::sqrt(share * (1 - share) / static_cast<double>(count));
  EXPECT_GE(box * share, v->lower - spread);
  EXPECT_LE(box * share, v->upper + spread);
}

// Three parallel axes of which another than joint 3 stops have no bounds, and say so.
TEST(SixJointBounds, OtherArmsAreSampled) {
  EXPECT_TRUE(has_bounds(*machine::load("ur10e")));
  EXPECT_TRUE(has_bounds(*machine::load("kuka-kr210")));
  const SixCase stops{"", "ur10e", {kWhole, {-100, 100}, kWhole, kWhole, kWhole, kWhole}};
  EXPECT_FALSE(has_bounds(AnyMachine(arm_of(stops))));
}

}  // namespace
}  // namespace polypod::workspace
