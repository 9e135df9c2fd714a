// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Motion of deltas against differences, the source's sample move, and limits looked at between the samples.
#include <gtest/gtest.h>

#include <random>

#include "machines.hpp"

#include "polypod/core/units.hpp"
#include "polypod/families/delta/drives.hpp"
#include "polypod/families/delta/kinematics.hpp"
#include "polypod/motion/cycles.hpp"

namespace polypod::motion {
namespace {

using test::load;

using machine::LinearDelta;
using machine::RotaryDelta;

TEST(Path, ArcsRunThroughTheirPoints) {
  const Vec3 a(0.1, 0, 0.5), b(0, 0.1, 0.5), c(-0.1, 0, 0.5);
  const auto half = arc(a, b, c);
  ASSERT_TRUE(half);
  EXPECT_NEAR(half->length, std::numbers::pi * 0.1, 1e-12);
  EXPECT_LT((half->at(half->length).p - c).norm(), 1e-12);
  EXPECT_LT((half->at(0.5 * half->length).p - b).norm(), 1e-12);
  const auto long_way = arc(a, c, b);  // three quarters, through c first
  EXPECT_NEAR(long_way->length, 1.5 * std::numbers::pi * 0.1, 1e-12);
  const double h = 1e-4, s = 0.05;  // derivatives against s
  const auto at = [&](double t) { return half->at(t); };
  EXPECT_LT(((at(s + h).p - at(s - h).p) / (2 * h) - at(s).v).norm(), 1e-6);
  EXPECT_LT(((at(s + h).v - at(s - h).v) / (2 * h) - at(s).a).norm(), 1e-5);
  EXPECT_LT(((at(s + h).a - at(s - h).a) / (2 * h) - at(s).j).norm(), 1e-3);
}

TEST(Path, BadPaths) {
  EXPECT_EQ(path_through({Vec3(0, 0, 0.5)}).error().id, "MO100");
  EXPECT_EQ(path_through({}).error().id, "MO100");
  EXPECT_EQ(path_through({Vec3(0, 0, 0.5), Vec3(0, 0, 0.5)}).error().id, "MO100");
  EXPECT_EQ(arc(Vec3(0, 0, 0), Vec3(1, 0, 0), Vec3(2, 0, 0)).error().id, "MO102");
  const auto path = *path_through({Vec3(0, 0, 0.5), Vec3(0.1, 0, 0.5)});
  EXPECT_EQ(run(load("delta-brno"), path, 0).error().id, "MO101");
  EXPECT_EQ(run(load("delta-brno"), path, -1).error().id, "MO101");
  EXPECT_EQ(run(load("hexapod-strut"), path, 1).error().id, "MO103");
}

/// KOZ 4.3.2: (200, -200, 450) to (-200, 200, 550) mm at 0.5 m/s.
TEST(Run, TheSampleMoveOfTheSource) {
  const AnyMachine any = load("delta-brno");
  const auto& m = std::get<RotaryDelta>(any);
  const Vec3 from(0.2, -0.2, 0.45), to(-0.2, 0.2, 0.55);
  const auto r = run(any, *path_through({from, to}), 0.5);
  ASSERT_TRUE(r);
  EXPECT_TRUE(r->ok());
  EXPECT_NEAR(r->length, std::sqrt(0.4 * 0.4 + 0.4 * 0.4 + 0.1 * 0.1), 1e-12);
  EXPECT_NEAR(r->length, 0.5745, 5e-5);
  EXPECT_NEAR(r->time, 1.149, 5e-4);
  double first[3], last[3];
  ASSERT_TRUE(drive_positions(m, from, first) && drive_positions(m, to, last));
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(r->samples.front().drive[i].q, first[i], 1e-12);
    EXPECT_NEAR(r->samples.back().drive[i].q, last[i], 1e-12);
  }
}

/// Derivatives of the drives against central differences of the inverse, along an arc.
template <class M>
void check_derivatives(const AnyMachine& any, const Vec3& middle) {
  const M& m = std::get<M>(any);
  const auto path =
      path_of({*arc(middle + Vec3(0.08, 0, 0), middle + Vec3(0, 0.07, 0.02), middle + Vec3(-0.06, -0.05, 0.03))});
  const double speed = 0.7;
  const auto at = [&](double t) {
    Motion motion = path->at(speed * t);
    motion.v *= speed;
    motion.a *= speed * speed;
    motion.j *= speed * speed * speed;
    return drives_of(m, t, motion);
  };
  const double h = 1e-5;
  for (double t = 0.02; t < path->length / speed - 0.02; t += 0.01) {
    const Sample before = at(t - h), here = at(t), after = at(t + h);
    ASSERT_TRUE(here.reached);
    for (int i = 0; i < 3; ++i) {
      const DriveMotion &a = before.drive[i], &b = here.drive[i], &c = after.drive[i];
      EXPECT_NEAR((c.q - a.q) / (2 * h), b.speed, 1e-6 * (1 + std::abs(b.speed)));
      EXPECT_NEAR((c.speed - a.speed) / (2 * h), b.acceleration, 1e-5 * (1 + std::abs(b.acceleration)));
      EXPECT_NEAR((c.acceleration - a.acceleration) / (2 * h), b.jerk, 1e-4 * (1 + std::abs(b.jerk)));
    }
  }
}
TEST(Drives, DerivativesOfArms) {
  check_derivatives<RotaryDelta>(load("delta-brno"), Vec3(0.05, 0.02, 0.5));
}
TEST(Drives, DerivativesOnRails) {
  check_derivatives<LinearDelta>(load("delta-linear"), Vec3(0.01, 0.02, 0.6));
}

TEST(Run, SaysWhereAPathLeavesAndWhy) {
  const AnyMachine m = load("delta-brno");
  const auto down = run(m, *path_through({Vec3(0, 0, 0.6), Vec3(0, 0, 0.7)}), 0.1);
  ASSERT_TRUE(down);
  ASSERT_FALSE(down->ok());
  EXPECT_EQ(down->problems.front().kind, "limit");
  EXPECT_EQ(down->problems.front().detail, "z above its largest value");
  EXPECT_NEAR(down->problems.front().s, 0.0645, 1e-8);  // 664.5 mm
  EXPECT_NEAR(down->problems.front().t, 0.645, 1e-7);
  // Without that limit: the arms are stretched at sqrt((c + d)^2 - (R - r)^2) = 714.45 mm.
  const auto free =
      run(load("delta-brno", {{"limits.z_max_mm", "900"}}), *path_through({Vec3(0, 0, 0.6), Vec3(0, 0, 0.75)}), 0.1);
  ASSERT_EQ(free->problems.size(), 2U);
  EXPECT_EQ(free->problems[0].kind, "singular");
  EXPECT_LT(free->problems[0].s, free->problems[1].s);
  EXPECT_NEAR(0.6 + free->problems[1].s, std::sqrt(std::pow(0.5539 + 0.1799, 2) - std::pow(0.25 - 0.0826, 2)), 1e-8);
  const auto corner = run(m, *path_through({Vec3(0, 0, 0.5), Vec3(0.1, 0, 0.5), Vec3(0.1, 0.1, 0.5)}), 0.1);
  ASSERT_EQ(corner->problems.size(), 1U);
  EXPECT_EQ(corner->problems[0].kind, "corner");
  EXPECT_NEAR(corner->problems[0].s, 0.1, 1e-12);
}

/// With drives that do not matter, a cycle that stops in its corners is three moves whose times have a closed form: a
/// move of a piecewise constant jerk alone takes cbrt(32 d / j).
TEST(Plan, ThreeMovesByJerkAlone) {
  Cycle cycle{Vec3(-0.1525, 0, 0.55), Vec3(0.1525, 0, 0.55), 0.025, 0};
  MotionLimits limits;
  limits.tool = {1e3, 1e6, 100};
  limits.drive = {1e6, 1e9, 1e12};
  const auto p = plan(load("delta-brno"), cycle, limits);
  ASSERT_TRUE(p);
  const double expected = 2 * std::cbrt(32 * 0.025 / 100) + std::cbrt(32 * 0.305 / 100);
  EXPECT_GT(p->time, expected * (1 - 1e-9));
  EXPECT_LT(p->time, expected * 1.03);  // the search ends within a few per cent of the best shape
  EXPECT_EQ(p->limited_by, "tool jerk");
}

TEST(Plan, LimitsHoldEverywhereAndOneIsMet) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> across(-0.2, 0.2), down(0.46, 0.6), factor(0.3, 3);
  for (const char* name : {"delta-brno", "delta-picker"}) {
    const AnyMachine m = load(name);
    const double lower = std::string(name) == "delta-picker" ? 0.35 : 0;
    int planned = 0;
    for (int k = 0; k < 40; ++k) {
      const double z = lower + down(random);
      Cycle cycle{Vec3(across(random), across(random), z), Vec3(across(random), across(random), z - 0.01), 0.025,
                  0.015};
      MotionLimits limits;
      limits.tool.acceleration *= factor(random);
      limits.drive.acceleration *= factor(random);
      limits.drive.jerk *= factor(random);
      const auto p = plan(m, cycle, limits);
      if (!p) continue;
      ++planned;
      const auto r = run(m, cycle, *p, 5000);
      ASSERT_TRUE(r);
      EXPECT_TRUE(r->ok());
      EXPECT_LT((r->samples.front().tool.p - cycle.from).norm(), 1e-12);
      EXPECT_LT((r->samples.back().tool.p - cycle.to).norm(), 1e-12);
      constexpr double kBetween = 1.002;  // between the times that the plan looks at
      double met = std::max({r->tool.speed / limits.tool.speed, r->tool.acceleration / limits.tool.acceleration,
                             r->tool.jerk / limits.tool.jerk});
      for (int i = 0; i < 3; ++i) {
        met = std::max({met, r->drive[i].speed / limits.drive.speed,
                        r->drive[i].acceleration / limits.drive.acceleration, r->drive[i].jerk / limits.drive.jerk});
      }
      EXPECT_LT(met, kBetween);
      EXPECT_GT(met, 0.97) << p->limited_by;  // a jerk's peak at a jump lies between the samples of equal time
      for (const Sample& s : r->samples) {    // never off the way up before the corner may be cut
        const bool over =
            (s.tool.p - cycle.from).head<2>().norm() > 1e-9 && (s.tool.p - cycle.to).head<2>().norm() > 1e-9;
        if (over) {
          EXPECT_LE(s.tool.p.z(), cycle.from.z() - p->height_at_over + 1e-9);
        }
      }
    }
    EXPECT_GT(planned, 20) << name;
  }
}

TEST(Plan, RoundingSavesTime) {
  const AnyMachine m = load("delta-brno");
  double last = 1e9;
  for (const double rounding : {0.0, 0.01, 0.02, 0.025}) {
    const auto p = plan(m, {Vec3(-0.1525, 0, 0.55), Vec3(0.1525, 0, 0.55), 0.025, rounding}, {});
    ASSERT_TRUE(p);
    EXPECT_LT(p->time, last);
    last = p->time;
  }
}

TEST(Plan, BadCycles) {
  const AnyMachine m = load("delta-brno");
  const Vec3 a(-0.1, 0, 0.55), b(0.1, 0, 0.55);
  const auto id = [&](const Cycle& cycle, const MotionLimits& limits = {}) {
    const auto p = plan(m, cycle, limits);
    return p ? std::string("none") : p.error().id;
  };
  EXPECT_EQ(id({a, a, 0.025, 0.01}), "MO105");
  EXPECT_EQ(id({a, b, 0, 0}), "MO105");
  EXPECT_EQ(id({a, b, 0.025, 0.03}), "MO105");
  MotionLimits still;
  still.drive.speed = 0;
  EXPECT_EQ(id({a, b, 0.025, 0.01}, still), "MO101");
  EXPECT_EQ(id({Vec3(-0.6, 0, 0.6), b, 0.025, 0.01}), "MO106");
}

}  // namespace
}  // namespace polypod::motion
