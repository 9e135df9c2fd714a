// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Workspaces of deltas against closed forms, a scan, an integral over the drives and sampling of single verdicts.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <map>
#include <random>
#include <set>

#include "machines.hpp"

#include "../families/delta/bounds.hpp"
#include "polypod/core/units.hpp"
#include "polypod/families/delta/study.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/workspace/fit.hpp"
#include "polypod/workspace/shape.hpp"

namespace polypod::workspace {
namespace {

using test::load;

using machine::LinearDelta;
using machine::RotaryDelta;

Options to(double tolerance) {
  Options options;
  options.relative_tolerance = tolerance;
  return options;
}

/// Upright rails: above a point of the common part of three circles carriage i stands S_i = sqrt(c^2 - distance_i^2)
/// behind the tool, so that the tool runs through the rail's length less the greatest difference of the S_i. Integrated
/// in polar coordinates.
double upright_rails(double radius, double reach, double rail) {
  double sum = 0;
  constexpr int kAround = 1200, kOut = 1200;
  for (int k = 0; k < kAround; ++k) {
    const double angle = 2 * std::numbers::pi * (k + 0.5) / kAround;
    for (int j = 0; j < kOut; ++j) {
      const double r = reach * (j + 0.5) / kOut;
      double least = 1e9, most = 0;
      for (int i = 0; i < 3; ++i) {
        const double from = angle - (std::numbers::pi / 2 + 2 * std::numbers::pi * i / 3);
        const double under = reach * reach - r * r - radius * radius + 2 * r * radius * std::cos(from);
        least = std::min(least, under < 0 ? -1e9 : std::sqrt(under));
        most = std::max(most, std::sqrt(std::max(0.0, under)));
      }
      sum += std::max(0.0, rail - (most - least)) * r * (reach / kOut) * (2 * std::numbers::pi / kAround);
    }
  }
  return sum;
}

TEST(DeltaVolume, UprightRailsByTheirClosedForm) {
  for (const char* radius : {"40", "120"}) {
    const AnyMachine m =
        load("delta-linear", {{"platform.radius_mm", radius}, {"joint.side_deg", "90"}, {"joint.platform_deg", "90"}});
    Options options = to(5e-3);
    options.limits &= ~*limit_bits(m, "mode");
    const Volume v = *volume(m, options);
    const double expected = upright_rails(0.2 - 1e-3 * std::stod(radius), 0.34, 0.5);
    constexpr double kQuadrature = 1e-4;  // the middle rule across the border, halved with twice the points
    EXPECT_LE(v.lower, expected * (1 + kQuadrature)) << radius;
    EXPECT_GE(v.upper, expected * (1 - kQuadrature)) << radius;
    EXPECT_LE(v.upper - v.lower, 5e-3 * v.volume);
  }
}

/// The same volume from the other side: |det dX/dq| integrated over the drives, by forward kinematics, where the
/// inverse leads back (the source's own way to its workspace, KOZ 4.5.1.2, with weights).
TEST(DeltaVolume, IntegralOverTheDrives) {
  for (const char* low : {"42", "20"}) {
    const AnyMachine any = load("delta-brno", {{"drive.angle_min_deg", low}});
    const auto& m = std::get<RotaryDelta>(any);
    const Volume v = *volume(any, to(2e-3));
    double sum = 0, sum2 = 0;
    constexpr int kSamples = 2'000'000;
    std::mt19937 random(11);
    std::uniform_real_distribution<double> angle(m.range.min, m.range.max);
    const std::vector<double> p = kinematics::nominal_parameters(m);
    machine::JointVector q(3), back(3);
    for (int k = 0; k < kSamples; ++k) {
      for (int i = 0; i < 3; ++i) q[i] = angle(random);
      const auto both = both_poses(m, q);
      if (!both.real || both.machine.z() > m.high.z()) continue;
      if (!drive_positions(m, both.machine, back.data()) || (back - q).cwiseAbs().maxCoeff() > 1e-6) continue;
      const auto pair = jacobians(m, both.machine, q);
      bool below = true;  // every elbow above its platform joint
      for (int i = 0; i < 3; ++i) below = below && pair.A(i, 2) >= 0;
      if (!below) continue;
      const double weight = std::abs(pair.determinant_B() / pair.determinant_A());
      sum += weight;
      sum2 += weight * weight;
    }
    const double cube = std::pow(m.range.max - m.range.min, 3);
    const double mean = sum / kSamples, error = std::sqrt((sum2 / kSamples - mean * mean) / kSamples);
    EXPECT_GT(mean * cube, v.lower - 4 * error * cube) << low;
    EXPECT_LT(mean * cube, v.upper + 4 * error * cube) << low;
    EXPECT_LT(error * cube, 0.01 * v.volume);
  }
}

TEST(DeltaVolume, ScanLiesBetweenTheBounds) {
  for (const char* name : {"delta-brno", "delta-linear", "delta-picker"}) {
    const AnyMachine m = load(name);
    Options options = to(0.005);
    options.interference = true;
    const Volume v = *volume(m, options);
    const double scan = scan_volume(m, options, v.min, v.max, 40);
    constexpr double kScan = 0.01;  // 40^3 points: a surface cell is 1/40 of the box, and its errors cancel
    EXPECT_GT(scan, v.lower * (1 - kScan)) << name;
    EXPECT_LT(scan, v.upper * (1 + kScan)) << name;
    EXPECT_LE(v.upper - v.lower, 0.005 * v.volume);
  }
}

constexpr const char* kCrowded = R"(
family = "rotary-delta"
arms = [
  { base_mm = [0, 200, 5], direction_deg = 88, arm_mm = 300, rod_mm = 700, platform_mm = [2, 50, -3] },
  { base_mm = [-180, -100, 0], direction_deg = 212, arm_mm = 310, rod_mm = 690, platform_mm = [-40, -25, 0] },
  { base_mm = [170, -110, -8], direction_deg = 331, arm_mm = 290, rod_mm = 710, platform_mm = [42, -22, 1] },
]
drive = { angle_min_deg = 50, angle_max_deg = 170 }
joint = { side_deg = 40, elbow_min_deg = 25, elbow_max_deg = 140, platform_deg = 70 }
base = { thickness_mm = 60 }
arm = { diameter_mm = 60 }
rod = { diameter_mm = 30, spacing_mm = 80 }
table = { z_mm = 800 }
limits = { x_min_mm = -400, z_max_mm = 780 }
tool = { length_mm = 40 }
)";
constexpr const char* kCrowdedRails = R"(
family = "linear-delta"
base = { radius_mm = 200, thickness_mm = 50 }
platform = { radius_mm = 40 }
rail = { length_mm = 500, incline_deg = 15, diameter_mm = 60 }
rod = { length_mm = 340, diameter_mm = 20, spacing_mm = 50 }
joint = { side_deg = 45, elbow_min_deg = 10, elbow_max_deg = 80, platform_deg = 70 }
table = { z_mm = 650 }
tool = { length_mm = 45 }
)";

/// What all groups say together of a cell, against the limits at its corners and at points inside.
template <class M>
void check_verdicts(const AnyMachine& any, const Vec3& spread) {
  const M& m = std::get<M>(any);
  Options options;
  options.interference = true;
  const DeltaBounds<M> bounds_of(m, options);
  ASSERT_LE(bounds_of.groups(), 31);
  const Patch patch = make_rectangle({0, 0}, {0, 0});
  std::mt19937 random(20261121);
  const auto uniform = [&](double a, double b) { return std::uniform_real_distribution<double>(a, b)(random); };
  int inside = 0, outside = 0, undecided = 0;
  std::set<int> seen;
  for (int k = 0; k < 6000; ++k) {
    const double size = std::pow(10.0, uniform(-3.5, -1.5));
    const Vec3 half(size, size * uniform(0.3, 1), size * uniform(0.3, 1));
    const Vec3 center = m.home + Vec3(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1)).cwiseProduct(spread);
    bool all_inside = true, some_outside = false, open = false;
    std::vector<Bound> planes;
    for (int group = 0; group < bounds_of.groups(); ++group) {
      BoundList bounds;
      const Verdict verdict = bounds_of.judge(group, center, half, half.norm(), patch, {}, bounds);
      all_inside = all_inside && verdict == Verdict::inside;
      some_outside = some_outside || verdict == Verdict::outside || verdict == Verdict::dead;
      open = open || verdict == Verdict::open;
      if (verdict == Verdict::undecided) planes.insert(planes.end(), bounds.begin(), bounds.end());
    }
    (all_inside ? inside : some_outside ? outside : undecided)++;
    for (int sample = 0; sample < 14; ++sample) {
      Vec3 x(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1));
      if (sample < 8) x = Vec3(sample & 1 ? 1 : -1, sample & 2 ? 1 : -1, sample & 4 ? 1 : -1);
      x = x.cwiseProduct(half);
      const auto solutions = kinematics::inverse(any, Pose{Mat3::Identity(), center + x}).solutions;
      const LimitBits broken = solutions.empty() ? ~LimitBits{0} : solutions.front().violations;
      for (int bit = 0; bit < machine::DeltaLimits::kCount && !solutions.empty(); ++bit)
        if ((broken >> bit & 1U) != 0) seen.insert(bit);
      if (all_inside) {
        EXPECT_EQ(broken, 0U) << k;
      }
      if (some_outside) {
        EXPECT_NE(broken, 0U) << k;
      }
      if (all_inside || some_outside || open) continue;
      bool foreseen = false, cut = false;
      for (const Bound& b : planes) {
        foreseen = foreseen || b.m + b.G.dot(x) < 0;
        cut = cut || b.M + b.G.dot(x) < 0;
      }
      if (broken != 0) {
        EXPECT_TRUE(foreseen) << k;
      }
      if (broken == 0) {
        EXPECT_FALSE(cut) << k;
      }
    }
  }
  EXPECT_GT(inside, 200);
  EXPECT_GT(outside, 300);
  EXPECT_GT(undecided, 300);
  using L = machine::DeltaLimits;
  for (const int limit : {L::kMin, L::kSide, L::kElbow, L::kPlatform, L::kTable, L::kRods}) {
    EXPECT_TRUE(std::any_of(seen.begin(), seen.end(), [&](int s) { return s >= limit && s < limit + 3; })) << limit;
  }
}

TEST(DeltaBoundsTest, VerdictsAboutArmsHoldAtEveryPoint) {
  check_verdicts<RotaryDelta>(*machine::from_text(kCrowded, "a.toml"), Vec3(0.45, 0.45, 0.4));
}
TEST(DeltaBoundsTest, VerdictsAboutRailsHoldAtEveryPoint) {
  check_verdicts<LinearDelta>(*machine::from_text(kCrowdedRails, "a.toml"), Vec3(0.2, 0.2, 0.35));
}

TEST(DeltaVolume, TiltIsRefused) {
  Options options;
  options.directions.tilt = 0.1;
  const auto v = volume(load("delta-brno"), options);
  ASSERT_FALSE(v);
  EXPECT_EQ(v.error().id, "WS104");
}

TEST(DeltaVolume, SameBitsWithAnyNumberOfThreads) {
  const AnyMachine m = load("delta-brno");
  Options one = to(0.02), many = to(0.02);
  one.threads = 1;
  many.threads = 8;
  const Volume a = *volume(m, one), b = *volume(m, many);
  EXPECT_EQ(a.lower, b.lower);
  EXPECT_EQ(a.upper, b.upper);
}

TEST(DeltaField, MarginIsZeroOnTheBorderAndTiltIsNone) {
  const AnyMachine m = load("delta-brno");
  const auto s = section(m, Options{}, Plane{Vec3::Zero(), Vec3::UnitX()}, 40);
  ASSERT_TRUE(s);
  EXPECT_FALSE(s->border.empty());
  for (const Loop& loop : s->border)
    for (std::size_t k = 0; k < loop.size(); k += 7) {
      // A step outwards is out of limits, a step inwards is within, to the accuracy of the border.
      const Vec3 along = (loop[(k + 1) % loop.size()] - loop[k]).normalized();
      const Vec3 in = s->field.grid.step[0].cross(s->field.grid.step[1]).normalized().cross(along);
      int reached = 0;
      for (const double step : {-2e-3, 2e-3}) {
        reached += kinematics::inverse(m, Pose{Mat3::Identity(), loop[k] + step * in}).reachable() != nullptr ? 1 : 0;
      }
      EXPECT_GE(reached, 1);
    }
  for (const double tilt : s->field.tilt) EXPECT_LT(tilt, units::from_deg(0.01));
  // The source's cloud lies in the volume's box, and reaches to it.
  const Volume v = *volume(m, to(0.01));
  const auto cloud = *drive_cloud(m, 40);
  Vec3 low = cloud.front(), high = cloud.front();
  for (const Vec3& X : cloud) {
    low = low.cwiseMin(X);
    high = high.cwiseMax(X);
  }
  EXPECT_TRUE((low.array() >= v.min.array() - 1e-9).all() && (high.array() <= v.max.array() + 1e-9).all());
  EXPECT_GT((high - low).prod(), 0.5 * (v.max - v.min).prod());
}

TEST(DeltaStudy, MethodsAgreeInsideAndTheContractedStateComesWithTwentyDegrees) {
  DeltaStudyOptions options;
  options.step = 0.02;
  for (const char* low : {"42", "20"}) {
    const AnyMachine m = load("delta-brno", {{"drive.angle_min_deg", low}});
    const DeltaStudy s = *delta_study(m, options);
    EXPECT_GT(s.deep.points, 5000);
    EXPECT_GE(s.deep.agree_percent(), 98);
    EXPECT_EQ(s.deep.geometry, 0) << low;  // singular poses lie on the border alone
    EXPECT_EQ(s.deep.determinant, 0) << low;
    const bool contracted = s.all.least_folded < 0.05;
    EXPECT_EQ(contracted, std::string(low) == "20");
    EXPECT_EQ(s.all.agree(), s.all.points - (s.all.geometry - s.all.both) - (s.all.determinant - s.all.both));
  }
  // The contracted state: arm and rod folded over each other, on the axis where |P - Q| = c - d, at 334.5 mm and 26.6
  // deg: within 20 .. 260 deg, out of 42 .. 260.
  const double z = std::sqrt(std::pow(0.5539 - 0.1799, 2) - std::pow(0.25 - 0.0826, 2));
  const AnyMachine wide = load("delta-brno", {{"drive.angle_min_deg", "20"}}), narrow = load("delta-brno");
  for (const AnyMachine& m : {wide, narrow}) {
    const Vec3 X(0, 0, z + 1e-9);
    const auto close = closeness(std::get<RotaryDelta>(m), X);
    EXPECT_TRUE(close.folded);
    EXPECT_LT(close.elbow_gap, 1e-3);
    EXPECT_LT(std::abs(close.det_B), 1e-9);
    EXPECT_GT(close.pose_gap, 0.5);
  }
  const auto reached = [&](const AnyMachine& m) {
    return kinematics::inverse(m, Pose{Mat3::Identity(), Vec3(0, 0, z + 1e-4)}).reachable() != nullptr;
  };
  EXPECT_TRUE(reached(wide));
  EXPECT_FALSE(reached(narrow));
}

TEST(DeltaStudy, MachinesAndNumbersThatDoNotFit) {
  EXPECT_EQ(delta_study(load("lola50")).error().id, "WS140");
  DeltaStudyOptions options;
  options.step = 0;
  EXPECT_EQ(delta_study(load("delta-brno"), options).error().id, "WS141");
}

TEST(DeltaVolume, ClearanceKeepsPosesThatAreFarFromSingular) {
  // Far more than the source's 10 mm, so that it cuts much.
  for (const auto& [name, distance] : {std::pair{"delta-brno", 0.3}, std::pair{"delta-linear", 0.2}}) {
    const AnyMachine m = load(name);
    Options options = to(0.01);
    options.singular_distance = distance;
    const Volume all = *volume(m, to(0.01)), clear = *volume(m, options);
    EXPECT_LT(clear.upper, 0.95 * all.lower) << name;
    // A scan with both, by the definition of the distances.
    int inside = 0;
    constexpr int kSteps = 40;
    for (int i = 0; i < kSteps * kSteps * kSteps; ++i) {
      const Vec3 X =
          all.min +
          Vec3(i % kSteps + 0.5, i / kSteps % kSteps + 0.5, i / kSteps / kSteps + 0.5).cwiseProduct(all.max - all.min) /
              kSteps;
      const auto close = std::visit(
          [&]<class M>(const M& family) {
            if constexpr (machine::DeltaFamily<M>) return closeness(family, X);
            return machine::Closeness{};
          },
          m);
      if (!close.reached || close.least() < options.singular_distance) continue;
      inside += kinematics::inverse(m, Pose{Mat3::Identity(), X}).solutions.front().violations == 0 ? 1 : 0;
    }
    const double scan = inside * (all.max - all.min).prod() / std::pow(kSteps, 3);
    constexpr double kScan = 0.02;
    EXPECT_GT(scan, clear.lower * (1 - kScan)) << name;
    EXPECT_LT(scan, clear.upper * (1 + kScan)) << name;
  }
  Options options = to(0.1);
  options.singular_distance = 0.01;
  EXPECT_EQ(volume(load("hexapod-strut"), options).error().id, "WS105");
}

TEST(DeltaShape, TheLargestCuboidIsInsideAndClearOfSingularPoses) {
  const AnyMachine m = load("delta-brno");
  Options options = to(0.1);
  options.singular_distance = 0.01;
  for (const ShapeKind kind : {ShapeKind::box, ShapeKind::cylinder}) {
    const auto shape = largest_inside(m, options, kind);
    ASSERT_TRUE(shape);
    EXPECT_GT(shape->volume(), 0.02);  // m^3
    std::mt19937 random(4);
    std::uniform_real_distribution<double> unit(-1, 1);
    for (int k = 0; k < 20000; ++k) {
      Vec3 d(unit(random), unit(random), unit(random));
      if (kind == ShapeKind::cylinder && d.head<2>().norm() > 1) continue;
      const Vec3 X = shape->center + d.cwiseProduct(shape->half);
      const auto solutions = kinematics::inverse(m, Pose{Mat3::Identity(), X}).solutions;
      ASSERT_FALSE(solutions.empty());
      EXPECT_EQ(solutions.front().violations, 0U);
      EXPECT_GE(closeness(std::get<RotaryDelta>(m), X).least(), 0.01);
    }
  }
}

/// Limits of the task that lie within all others leave a box, none of whose cells is off its border.
TEST(DeltaShape, AWorkspaceThatIsABoxHoldsItself) {
  AnyMachine m = load("delta-brno");
  for (const auto& [key, value] : std::map<std::string, double>{{"limits.x_min_mm", -10},
                                                                {"limits.x_max_mm", 10},
                                                                {"limits.y_min_mm", -10},
                                                                {"limits.y_max_mm", 10},
                                                                {"limits.z_min_mm", 400},
                                                                {"limits.z_max_mm", 450}}) {
    m = *machine::with_value(m, key, value);
  }
  const auto shape = largest_inside(m, to(0.1), ShapeKind::box);
  ASSERT_TRUE(shape) << to_string(shape.error());
  EXPECT_LT(shape->volume(), 20e-6);
  EXPECT_GT(shape->volume(), 19.9e-6);  // m^3
}

/// What fit proposes makes the points fit, and a little less does not.
TEST(Fit, ProposalsMakeTheTaskFit) {
  const std::vector<Vec3> points{Vec3(0.3, 0, 0.6), Vec3(-0.3, 0, 0.6), Vec3(0, 0.1, 0.55)};
  const AnyMachine m = load("delta-brno");
  const auto fit = fit_points(m, {}, points);
  ASSERT_TRUE(fit);
  EXPECT_FALSE(fit->fits);
  const auto all = [&](const AnyMachine& machine, const Vec3& shift) {
    return std::all_of(points.begin(), points.end(), [&](const Vec3& X) {
      const auto solutions = kinematics::inverse(machine, Pose{Mat3::Identity(), X - shift}).solutions;
      return !solutions.empty() && (solutions.front().violations & ~interference_bits(machine)) == 0;
    });
  };
  ASSERT_TRUE(fit->rod_length && fit->base_height && fit->placement);
  const auto with_rods = [&](double length) {
    return load("delta-brno", {{"rod.length_mm", std::to_string(units::to_mm(length))}});
  };
  EXPECT_TRUE(all(with_rods(fit->rod_length->nearest + 1e-6), Vec3::Zero()));
  EXPECT_FALSE(all(with_rods(fit->rod_length->nearest - 1e-5), Vec3::Zero()));
  EXPECT_TRUE(all(with_rods(fit->rod_length->high - 1e-6), Vec3::Zero()));
  EXPECT_FALSE(all(with_rods(fit->rod_length->high + 1e-5), Vec3::Zero()));
  EXPECT_TRUE(all(m, Vec3(0, 0, fit->base_height->nearest)));
  EXPECT_FALSE(all(m, Vec3(0, 0, fit->base_height->nearest - 1e-5)));
  EXPECT_TRUE(all(m, *fit->placement));
  EXPECT_LE(fit->placement->norm(), fit->base_height->nearest * 2);
  const auto inside = fit_points(m, {}, {Vec3(0, 0, 0.5)});
  EXPECT_TRUE(inside->fits);
  EXPECT_TRUE(inside->placement->isZero());
  EXPECT_NEAR(inside->rod_length->nearest, 0.5539, 1e-12);
  EXPECT_EQ(fit_points(m, {}, {}).error().id, "WS142");
  EXPECT_EQ(fit_points(load("lola50"), {}, {Vec3(0, 0, 0.5)}).error().id, "WS140");
}

TEST(Fit, DistancesAreDistances) {
  const auto fits = [](const AnyMachine& m, const Vec3& X) {
    const auto solutions = kinematics::inverse(m, Pose{Mat3::Identity(), X}).solutions;
    return !solutions.empty() && (solutions.front().violations & ~interference_bits(m)) == 0;
  };
  std::mt19937 engine(7);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  const auto in_ball = [&](double radius) {
    const Vec3 n = Vec3(normal(engine), normal(engine), normal(engine)).normalized();
    return Vec3(radius * std::cbrt(uniform(engine)) * n);
  };
  for (const char* name : {"delta-brno", "delta-linear"}) {
    const AnyMachine m = load(name);
    const double z = std::visit(
        []<class M>(const M& f) {
          if constexpr (machine::DeltaFamily<M>) return f.home.z();
          return 0.0;
        },
        m);
    for (const Vec3& X : {Vec3(0, 0, z), Vec3(0.05, -0.04, z + 0.02), Vec3(0.6, 0.1, z), Vec3(0.02, 0.03, z + 0.6)}) {
      SCOPED_TRACE(fmt::format("{} at {}, {}, {}", name, X.x(), X.y(), X.z()));
      const auto fit = fit_points(m, {}, {X});
      ASSERT_TRUE(fit);
      const PointFit& p = fit->points[0];
      EXPECT_EQ(p.fits, fits(m, X));
      ASSERT_TRUE(std::isfinite(p.distance));
      EXPECT_NEAR((p.boundary - X).norm(), p.distance, 1e-12);
      // The boundary is there, and no point that is nearer by more than 0.2 % is on its other side.
      const Vec3 n = (p.boundary - X).normalized();
      EXPECT_NE(fits(m, p.boundary - 1e-6 * n), fits(m, p.boundary + 1e-6 * n));
      for (int k = 0; k < 4000; ++k) {
        const Vec3 Y = X + in_ball(0.998 * p.distance);
        ASSERT_EQ(fits(m, Y), p.fits) << Y.transpose() << " is nearer by " << p.distance - (Y - X).norm();
      }
      if (p.fits) {
        EXPECT_GT(p.certain, 0.5 * p.distance);
        EXPECT_LT(p.certain, p.distance);
      } else {
        EXPECT_EQ(p.certain, 0);
      }
    }
  }
  // A plane 10 mm away, and which limit that is.
  const AnyMachine cut = load("delta-brno", {{"limits.z_max_mm", "510"}});
  const auto near = fit_points(cut, {}, {Vec3(0.01, 0.02, 0.5), Vec3(0.01, 0.02, 0.53)});
  EXPECT_NEAR(near->points[0].distance, 0.010, 1e-9);
  EXPECT_EQ(limit_label(cut, near->points[0].limit), "z above its largest value");
  EXPECT_GE(near->points[0].certain, 0.0095);
  EXPECT_NEAR(near->points[1].distance, 0.020, 1e-9);
  EXPECT_FALSE(near->points[1].fits);
}

}  // namespace
}  // namespace polypod::workspace
