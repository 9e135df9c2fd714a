// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Serial arms: first-order numbers against sampling, the workspace of LOLA 50 over ranges of A and B.
#include <gtest/gtest.h>

#include <numbers>

#include <random>

#include "../families/serial/bounds.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/workspace/shape.hpp"

namespace polypod::workspace {
namespace {

// Rounding of a few operations on numbers of order one.
constexpr double kRound = 1e-12;

struct Random {
  std::mt19937 engine{20260905};
  double operator()(double low, double high) { return std::uniform_real_distribution<double>(low, high)(engine); }
};

TEST(FirstOrder, FunctionsAreEnclosedOverTheirDomain) {
  Random random;
  for (int k = 0; k < 500; ++k) {
    const double size = std::pow(10.0, random(-3, -0.5));
    const Patch patch = make_rectangle({0, 0}, {size, 2 * size});
    const Domain d{Vec3(size, 0.5 * size, 2 * size), &patch};
    FirstOrder f = random(-2, 2), g = random(-2, 2);
    for (std::size_t i = 0; i < 5; ++i) {
      f.gradient[i] = random(-1, 1);
      g.gradient[i] = random(-1, 1);
    }
    const FirstOrder product = times(f, g, d), root_f = root(f, d), inverse = inverse_of_positive(f, d),
                     square_product = square(product, d);  // of a number with a rest of its own
    for (int sample = 0; sample < 30; ++sample) {
      std::array<double, 5> x{};
      for (std::size_t i = 0; i < 3; ++i) x[i] = random(-1, 1) * d.half[static_cast<Eigen::Index>(i)];
      x[3] = random(-0.5, 0.5) * size;
      x[4] = random(-1, 1) * size;
      const auto linear = [&](const FirstOrder& h) {
        double v = h.value;
        for (std::size_t i = 0; i < 5; ++i) v += h.gradient[i] * x[i];
        return v;
      };
      const double fx = linear(f), gx = linear(g);
      const auto encloses = [&](const FirstOrder& h, double value) {
        return !std::isfinite(h.rest) || std::abs(value - linear(h)) <= h.rest + kRound * (1 + std::abs(value));
      };
      EXPECT_TRUE(encloses(product, fx * gx));
      EXPECT_TRUE(encloses(root_f, std::sqrt(std::max(0.0, fx))));
      if (std::isfinite(inverse.rest)) {
        EXPECT_TRUE(encloses(inverse, 1 / fx));
      }
      EXPECT_TRUE(encloses(square_product, fx * gx * fx * gx));
    }
  }
}

TEST(ArmBounds, VerdictsHoldAtEveryPoint) {
  const auto any = *machine::load("lola50");
  const auto& arm = std::get<machine::SerialArm>(any);
  const auto wrist = *machine::WristInverse::of(arm);
  const ArmLimits limits(wrist.form(), ~LimitBits{0});
  Random random;
  int inside = 0, dead = 0, undecided = 0;
  for (int k = 0; k < 6000; ++k) {
    const double size = std::pow(10.0, random(-3, -1));
    const Vec3 half(size, size * random(0.3, 1), size * random(0.3, 1));
    const Vec3 center(random(-1.2, 1.2), random(-2.2, -0.2), random(-0.9, 0.9));
    const double a = random(-0.5, 0.5), b = random(-0.5, 0.5);
    const Patch patch = make_rectangle({a, b}, {a + size * random(0, 1), b + size * random(0, 1)});
    const auto data = limits.prepare(patch);
    BoundList bounds;
    const Verdict verdict = limits.judge(0, center, half, half.norm(), patch, data, bounds);
    bool all_broken = true, none_broken = true;
    for (int sample = 0; sample < 12; ++sample) {
      Vec3 x(random(-1, 1), random(-1, 1), random(-1, 1));
      if (sample < 8) x = Vec3(sample & 1 ? 1 : -1, sample & 2 ? 1 : -1, sample & 4 ? 1 : -1);
      x = x.cwiseProduct(half);
      const double sa = random(0, 1), sb = random(0, 1);
      const Mat3 R = rotation_y(patch.low[1] + sb * (patch.high[1] - patch.low[1])) *
                     rotation_x(patch.low[0] + sa * (patch.high[0] - patch.low[0]));
      const bool broken = machine::inverse(arm, Pose{R, center + x}).reachable() == nullptr;
      all_broken = all_broken && broken;
      none_broken = none_broken && !broken;
      if (broken && verdict == Verdict::undecided) {
        bool foreseen = false;
        for (const Bound& bound : bounds) foreseen = foreseen || bound.m + bound.G.dot(x) < 0;
        EXPECT_TRUE(foreseen) << "cell " << k;
      }
    }
    if (verdict == Verdict::inside) {
      ++inside;
      EXPECT_TRUE(none_broken) << "cell " << k;
    } else if (verdict == Verdict::dead) {
      ++dead;
      EXPECT_TRUE(all_broken) << "cell " << k;
    } else {
      ++undecided;
    }
  }
  EXPECT_GT(inside, 300);
  EXPECT_GT(dead, 300);
  EXPECT_GT(undecided, 300);
}

Options vertical(double tolerance) {
  Options options;
  options.relative_tolerance = tolerance;
  return options;
}

// SLAV 2.4.4 and FACTS: the box x -600..600, y -1600..-1000, z -400..100 mm at A = B = 0 is wholly inside.
TEST(ArmWorkspace, LolaCertainlyHoldsItsWorkingBox) {
  const auto lola = *machine::load("lola50");
  const Shape box{ShapeKind::box, Vec3(0, -1.3, -0.15), Vec3(0.6, 0.3, 0.25)};
  EXPECT_TRUE(*certainly_holds(lola, vertical(0.01), box));
  // Half a metre lower or farther out it is not.
  Shape lower = box, farther = box;
  lower.center.z() -= 0.5;
  farther.center.y() -= 0.5;
  EXPECT_FALSE(*certainly_holds(lola, vertical(0.01), lower));
  EXPECT_FALSE(*certainly_holds(lola, vertical(0.01), farther));
}

TEST(ArmWorkspace, BoundsHoldAScanAndShrinkWithTheRanges) {
  const auto lola = *machine::load("lola50");
  const Volume fixed = *volume(lola, vertical(0.02));
  EXPECT_TRUE(fixed.converged);
  const double scanned = scan_volume(lola, vertical(0.02), fixed.min, fixed.max, 60);
  EXPECT_NEAR(scanned / fixed.volume, 1, 0.02);
  Options tilted = vertical(0.2);
  tilted.directions.a_range = tilted.directions.b_range =
      std::array<double, 2>{units::from_deg(-30), units::from_deg(30)};
  const Volume ranges = *volume(lola, tilted);
  EXPECT_TRUE(ranges.converged);
  EXPECT_GT(ranges.lower, 0);
  EXPECT_LT(ranges.upper, fixed.lower);
  // The printed 5-axis part reaches from z = -350 to 100 mm (FACTS).
  EXPECT_LT(ranges.min.z(), -0.35);
  EXPECT_GT(ranges.max.z(), 0.1);
}

TEST(ArmWorkspace, LargestShapesAreInsideAndCannotGrow) {
  const auto lola = *machine::load("lola50");
  const Shape known{ShapeKind::box, Vec3(0, -1.3, -0.15), Vec3(0.6, 0.3, 0.25)};
  for (const ShapeKind kind : {ShapeKind::box, ShapeKind::cylinder, ShapeKind::ellipsoid}) {
    // Curved shapes of an arm take long to prove; a hexapod's are quick.
    const auto machine = kind == ShapeKind::ellipsoid ? *machine::load("hexapod-strut") : lola;
    const auto shape = largest_inside(machine, vertical(0.05), kind);
    ASSERT_TRUE(shape) << to_string(shape.error());
    EXPECT_TRUE(*certainly_holds(machine, vertical(0.05), *shape));
    Shape larger = *shape;
    larger.half *= 1.05;
    EXPECT_FALSE(*certainly_holds(machine, vertical(0.05), larger)) << name_of(kind);
    if (kind == ShapeKind::box) {
      EXPECT_GT(shape->volume(), known.volume());
    }
  }
}

/// Two links of 300 and 250 mm that turn freely reach an annulus.
TEST(ArmWorkspace, ArmsWithoutAClosedInverseAreSampled) {
  const auto scara = *machine::from_text(R"(
family = "serial"
task = "point"
dh = [ {a_mm=300}, {a_mm=250, alpha_deg=180}, {joint="prismatic"} ]
limits = [ {min_deg=-180, max_deg=180}, {min_deg=-180, max_deg=180}, {min_mm=0, max_mm=200} ]
)",
                                         "scara.toml");
  const auto v = volume(scara, vertical(0.05));
  ASSERT_TRUE(v.has_value());
  EXPECT_FALSE(v->proven);
  const double truth = std::numbers::pi * (0.55 * 0.55 - 0.05 * 0.05) * 0.2;
  EXPECT_LE(v->lower, truth);
  EXPECT_GE(v->upper, truth);
}

TEST(Shapes, HoldAndMeetBoxes) {
  const Shape ball{ShapeKind::ellipsoid, Vec3(1, 2, 3), Vec3(2, 2, 2)};
  EXPECT_TRUE(ball.holds_box(Vec3(1, 2, 3), Vec3(1.15, 1.15, 1.15)));   // corner at 1.99
  EXPECT_FALSE(ball.holds_box(Vec3(1, 2, 3), Vec3(1.16, 1.16, 1.16)));  // corner at 2.01
  EXPECT_TRUE(ball.meets_box(Vec3(4, 2, 3), Vec3(1.01, 1, 1)));
  EXPECT_FALSE(ball.meets_box(Vec3(4, 2, 3), Vec3(0.99, 1, 1)));
  const Shape can{ShapeKind::cylinder, Vec3::Zero(), Vec3(2, 2, 5)};
  EXPECT_TRUE(can.holds_box(Vec3::Zero(), Vec3(1.4, 1.4, 5)));
  EXPECT_FALSE(can.holds_box(Vec3::Zero(), Vec3(1.42, 1.42, 5)));
  EXPECT_NEAR(can.volume(), std::numbers::pi * 4 * 10, 1e-12);
  EXPECT_NEAR(ball.volume(), 4.0 / 3 * std::numbers::pi * 8, 1e-12);
}

}  // namespace
}  // namespace polypod::workspace
