// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Serial arms: first-order numbers against sampling, the workspace of LOLA 50 over ranges of A and B.
#include <gtest/gtest.h>

#include <fmt/format.h>

#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "../families/serial/bounds.hpp"
#include "planes.hpp"
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
    FirstOrder f = random(-2, 2), g = random(-2, 2), h = random(-2, 2);
    for (std::size_t i = 0; i < 5; ++i) {
      f.gradient[i] = random(-1, 1);
      g.gradient[i] = random(-1, 1);
      h.gradient[i] = random(-1, 1);
    }
    const FirstOrder product = times(f, g, d), root_f = root(f, d), inverse = inverse_of_positive(f, d),
                     square_product = square(product, d),  // of a number with a rest of its own
        length = norm({f, g, h}, d), length_of_products = norm({product, square(h, d), f}, d);
    for (int sample = 0; sample < 30; ++sample) {
      std::array<double, 5> x{};
      for (std::size_t i = 0; i < 3; ++i) x[i] = random(-1, 1) * d.half[static_cast<Eigen::Index>(i)];
      x[3] = random(-0.5, 0.5) * size;
      x[4] = random(-1, 1) * size;
      const auto linear = [&](const FirstOrder& of) {
        double v = of.value;
        for (std::size_t i = 0; i < 5; ++i) v += of.gradient[i] * x[i];
        return v;
      };
      const double fx = linear(f), gx = linear(g), hx = linear(h);
      const auto encloses = [&](const FirstOrder& of, double value) {
        return !std::isfinite(of.rest) || std::abs(value - linear(of)) <= of.rest + kRound * (1 + std::abs(value));
      };
      EXPECT_TRUE(encloses(product, fx * gx));
      EXPECT_TRUE(encloses(root_f, std::sqrt(std::max(0.0, fx))));
      if (std::isfinite(inverse.rest)) {
        EXPECT_TRUE(encloses(inverse, 1 / fx));
      }
      EXPECT_TRUE(encloses(square_product, fx * gx * fx * gx));
      EXPECT_TRUE(encloses(length, Vec3(fx, gx, hx).norm()));
      EXPECT_TRUE(encloses(length_of_products, Vec3(fx * gx, hx * hx, fx).norm()));
    }
    // No more than the tangent and what a sphere falls away from it.
    const double moved2 = f.radius(d) * f.radius(d) + g.radius(d) * g.radius(d) + h.radius(d) * h.radius(d);
    const double middle = Vec3(f.value, g.value, h.value).norm();
    if (middle > 2 * std::sqrt(moved2)) {
      EXPECT_LE(2 * length.rest, moved2 / middle * (1 + kRound));
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

// What the arms differ in is what the bounds treat apart: an offset of joint 1, both elbows, a forearm that counts
// backwards, the flipped wrist, a range of joint 4, long and short ranges, joint 5 near 90 deg on either side.
struct ArmCase {
  const char* name;
  std::string text;
};
std::string arm_text(double a1, double d4, std::array<std::array<double, 2>, 5> ranges, double tool = 0) {
  std::string text = fmt::format(R"(
family = "serial"
task = "axis"
convention = "standard"
dh = [
  {{ a_mm = {}, alpha_deg = 90, d_mm = 120, theta_offset_deg = -90 }},
  {{ a_mm = 850, alpha_deg = 0, d_mm = 0, theta_offset_deg = 90 }},
  {{ a_mm = 0, alpha_deg = 90, d_mm = 0, theta_offset_deg = 0 }},
  {{ a_mm = 0, alpha_deg = -90, d_mm = {}, theta_offset_deg = 0, sign = -1 }},
  {{ a_mm = 300, alpha_deg = 0, d_mm = 0, theta_offset_deg = 180 }},
]
tool = {{ b_deg = 90, c_deg = 180 }}
base = {{ x_mm = 10, y_mm = -20, z_mm = 30, a_deg = {} }}
limits = [
)",
                                 a1, d4, tool);
  for (const auto& [low, high] : ranges) text += fmt::format("  {{ min_deg = {}, max_deg = {} }},\n", low, high);
  return text + "]\n";
}
std::vector<ArmCase> arm_cases() {
  return {
      {"LOLA 50", arm_text(0, 1100, {{{-90, 90}, {-61, 43}, {-38, 89}, {-180, 180}, {-30, 89}}})},
      {"offset and both elbows", arm_text(150, 900, {{{-170, 170}, {-61, 60}, {-130, 120}, {-180, 180}, {-30, 89}}})},
      {"forearm backwards", arm_text(0, -900, {{{-90, 90}, {-100, 80}, {-150, 40}, {-180, 180}, {-80, 40}}})},
      {"range of joint 4", arm_text(100, 1100, {{{-120, 120}, {-61, 43}, {-38, 89}, {-100, 130}, {-89, 89}}})},
      {"long ranges", arm_text(50, 1000, {{{-180, 180}, {-140, 100}, {-80, 80}, {-180, 180}, {-120, 60}}})},
      {"joint 5 near 90", arm_text(0, 1100, {{{-90, 90}, {-61, 43}, {-38, 89}, {-180, 180}, {-88, 89.5}}})},
      {"joint 5 between 50 and 88", arm_text(0, 1100, {{{-90, 90}, {-61, 43}, {-38, 120}, {-180, 180}, {50, 88}}})},
      {"flipped wrist", arm_text(80, 1100, {{{-90, 90}, {-61, 43}, {-38, 89}, {-180, 180}, {91, 200}}})},
      {"slanted base", arm_text(0, 1100, {{{-90, 90}, {-61, 43}, {-38, 89}, {-180, 180}, {-30, 89}}}, 25)},
  };
}

/// How far the best branch stays within its ranges, rad; below 0 out of limits.
double margin_of(const machine::WristInverse& wrist, const machine::WristInverse::Form& form, const Vec3& p,
                 const Vec3& k) {
  machine::WristInverse::Branches branches;
  wrist.solve(p, k, branches);
  double best = -10;
  for (int b = 0; b < machine::WristInverse::kBranches; ++b) {
    if (!branches.exists[b]) continue;
    double least = 10;
    for (std::size_t i = 0; i < 5; ++i) {
      if (form.max[i] - form.min[i] >= 2 * std::numbers::pi - 1e-9) continue;
      const double q = branches.joints[b][static_cast<Eigen::Index>(i)];
      const double middle = 0.5 * (form.min[i] + form.max[i]), half = 0.5 * (form.max[i] - form.min[i]);
      least = std::min(least, half - std::abs(std::remainder(q - middle, 2 * std::numbers::pi)));
    }
    best = std::max(best, least);
  }
  return best;
}

/// The tool axis of a patch at parameters 0..1.
Vec3 axis_in(const Patch& patch, double s, double t) {
  const double a = patch.low[0] + s * (patch.high[0] - patch.low[0]),
               b = patch.low[1] + t * (patch.high[1] - patch.low[1]);
  if (!patch.sector) return (rotation_y(b) * rotation_x(a)).col(2);
  return rotation_of(a * Vec3(-std::sin(b), std::cos(b), 0)).col(2);
}

/// The least margin over a patch: a grid, then a search round its lowest point.
double least_margin(const machine::WristInverse& wrist, const Patch& patch, const Vec3& p, int steps = 24) {
  const auto form = wrist.form();
  double best = 10, s = 0, t = 0;
  const auto look = [&](double u, double v) {
    const double margin = margin_of(wrist, form, p, axis_in(patch, u, v));
    if (margin >= best) return false;
    best = margin;
    s = u;
    t = v;
    return true;
  };
  for (int i = 0; i <= steps; ++i)
    for (int j = 0; j <= steps && best >= 0; ++j) look(double(i) / steps, double(j) / steps);
  for (double step = 1.0 / steps; step > 1e-6 && best >= 0;) {
    bool better = false;
    for (const auto& [u, v] : {std::pair{1, 0}, std::pair{-1, 0}, std::pair{0, 1}, std::pair{0, -1}})
      better = look(std::clamp(s + u * step, 0.0, 1.0), std::clamp(t + v * step, 0.0, 1.0)) || better;
    if (!better) step *= 0.5;
  }
  return best;
}

class EachArm : public ::testing::TestWithParam<std::size_t> {};
INSTANTIATE_TEST_SUITE_P(ArmBounds, EachArm, ::testing::Range<std::size_t>(0, arm_cases().size()));

// Both sides of every verdict: a position that the planes from below keep is reached in all directions of the patch,
// one that a plane from above loses is not in some.
TEST_P(EachArm, PlanesHoldOnBothSides) {
  const ArmCase arm_case = arm_cases()[GetParam()];
  SCOPED_TRACE(arm_case.name);
  const auto any = machine::from_text(arm_case.text, "arm.toml");
  ASSERT_TRUE(any) << to_string(any.error());
  const auto wrist = *machine::WristInverse::of(std::get<machine::SerialArm>(*any));
  const auto form = wrist.form();
  const ArmLimits limits(form, ~LimitBits{0});
  constexpr double kNearZero = 1e-9;  // rad; limits are widened by 1e-12 of their terms
  Random random;
  random.engine.seed(7 + static_cast<unsigned>(GetParam()));
  test::PlanesSeen seen;
  for (int cell = 0; cell < 500; ++cell) {
    const double size = std::pow(10.0, random(-3.5, -1.2));
    const Vec3 half(size, size * random(0.3, 1), size * random(0.3, 1));
    Patch patch;
    const double width = size * random(0, 2);
    if (cell % 2 == 0) {
      const double a = random(-0.6, 0.6), b = random(-0.6, 0.6);
      patch = make_rectangle({a, b}, {a + width, b + width * random(0, 1)});
    } else {
      const double radius = random(0, 0.5), azimuth = random(0, 6);
      patch = make_sector({radius, azimuth}, {radius + width, azimuth + std::min(1.5, width / (radius + width))});
    }
    // Near the border, where the planes are: a pose with a joint at a limit.
    Vec3 center;
    const double reach = form.a2 + std::abs(form.d4);
    double best = 10;
    for (int t = 0; t < 40; ++t) {
      const Vec3 p(random(-1, 1) * reach, random(-1, 1) * reach, random(-1, 1) * reach);
      const double margin = std::abs(margin_of(wrist, form, p, axis_in(patch, 0.5, 0.5)));
      if (margin < best) {
        best = margin;
        center = p;
      }
    }
    test::expect_planes_hold(
        limits, center, half, patch, random, kNearZero, cell,
        [&](const Vec3& p) { return least_margin(wrist, patch, p); },
        [&](const Vec3& p) { return margin_of(wrist, form, p, axis_in(patch, random(0, 1), random(0, 1))); }, seen);
  }
  EXPECT_GT(seen.undecided(), 50);
  EXPECT_GT(seen.kept, 50);
  EXPECT_GT(seen.lost, 50);
}

// Points at random in the box of the bounds: in a box that is inside they are reached from the whole cone, beyond all
// boxes they are not, and the share of those that are reached lies between the bounds.
TEST_P(EachArm, ConesHoldAMonteCarlo) {
  const ArmCase arm_case = arm_cases()[GetParam()];
  SCOPED_TRACE(arm_case.name);
  const auto any = *machine::from_text(arm_case.text, "arm.toml");
  const auto wrist = *machine::WristInverse::of(std::get<machine::SerialArm>(any));
  Options options;
  options.relative_tolerance = 0.3;
  options.directions.tilt = units::from_deg(8);
  options.keep_cells = true;
  options.max_cells = 10000;  // arms of many branches take more; their bounds hold all the same
  options.bounds_tolerance = 0;
  const Volume v = *volume(any, options);
  EXPECT_GT(v.upper, 0);
  const Patch cone = whole_patch(options.directions);
  constexpr int kPoints = 200, kAzimuths = 48;
  Random random;
  int reached = 0, inside = 0, beyond = 0;
  for (int k = 0; k < kPoints; ++k) {
    Vec3 p;
    for (int i = 0; i < 3; ++i) p[i] = random(v.min[i], v.max[i]);
    const auto cell = std::find_if(v.cells.begin(), v.cells.end(), [&](const Cell& c) {
      return ((p - c.center).cwiseAbs().array() <= c.half.array()).all();
    });
    const bool in = least_margin(wrist, cone, p, kAzimuths) >= 0;
    reached += in ? 1 : 0;
    if (cell == v.cells.end()) {
      ++beyond;
      EXPECT_FALSE(in) << p.transpose();
    } else if (cell->state == CellState::inside) {
      ++inside;
      EXPECT_TRUE(in) << p.transpose();
    }
  }
  EXPECT_GT(beyond + inside, 20);
  const double box = (v.max - v.min).prod(), share = double(reached) / kPoints;
  const double spread = 4 * box * std::sqrt(share * (1 - share) / kPoints);  // 4 standard deviations
  EXPECT_GE(box * share, v.lower - spread);
  EXPECT_LE(box * share, v.upper + spread);
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
// Bounds over a cone would take hours to come within the tolerance: a sample is taken before long, without looking for
// the sides of bounds that are not used.
TEST(ArmWorkspace, AConeOfASixAxisArmIsSampledBeforeLong) {
  Options options;
  options.directions.tilt = units::from_deg(30);
  const auto v = volume(*machine::load("kuka-kr210"), options);
  ASSERT_TRUE(v.has_value());
  EXPECT_FALSE(v->proven);
  EXPECT_TRUE(v->converged);
  EXPECT_LT(v->points, 200'000);  // of the sample
  // Proven are, by 392 904 boxes, 34.18 to 41.88 m^3.
  EXPECT_GT(v->lower, 34.18);
  EXPECT_LT(v->upper, 41.88);
}

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
