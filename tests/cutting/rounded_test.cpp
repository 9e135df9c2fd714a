// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cutting/rounded.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "samples.hpp"

namespace polypod::cutting {
namespace {

using samples::kPi;

constexpr double kFeed = 5e-5;

Cutter rounded(double corner_radius) {
  Cutter cutter = samples::end_mill();
  cutter.corner_radius = corner_radius;
  return cutter;
}

/// The mean force by brute force over the cutting surface: points of the edge's body of revolution, their normal n from
/// its shape, h = feed . n, and forces along the directions in space. The material is where `inside` says.
template <class Inside>
Vec3 by_points(const Cutter& cutter, const Material& m, double ap, Inside&& inside) {
  constexpr int kAround = 2000, kAlong = 2000;
  const double R = cutter.radius(), r = cutter.corner_radius;
  const double arc = ap < r ? r * std::acos(1 - ap / r) : r * kPi / 2, length = arc + std::max(0.0, ap - r);
  Vec3 sum = Vec3::Zero();
  for (int i = 0; i < kAlong; ++i) {
    const double s = length * (i + 0.5) / kAlong;  // along the edge from the tip
    const double bow = r > 0 ? std::min(s / r, kPi / 2) : kPi / 2;
    const double rho = R - r + r * std::sin(bow);
    for (int j = 0; j < kAround; ++j) {
      const double phi = kPi * (j + 0.5) / kAround;
      const Vec3 out(std::sin(phi), std::cos(phi), 0);  // from the axis: phi from +y over +x
      if (!inside(rho * out)) continue;
      const Vec3 n = std::sin(bow) * out - std::cos(bow) * Vec3::UnitZ();
      const Vec3 motion = Vec3::UnitZ().cross(out) * -1;  // of a tooth: clockwise from above
      const Vec3 along = motion.cross(n);                 // up on the side
      const double h = std::max(0.0, kFeed * n.x());
      sum += -(m.kte + m.ktc * h) * motion - (m.kre + m.krc * h) * n + (m.kae + m.kac * h) * along;
    }
  }
  return cutter.teeth / (2 * kPi) * sum * (kPi / kAround) * (length / kAlong);
}

TEST(Rounded, RadiusZeroIsTheFlatCutter) {
  const Cutter flat = samples::end_mill();
  for (const double exponent : {1.0, 0.7}) {
    Material m = samples::aluminium();
    m.exponent = exponent;
    for (const CutSide side : {CutSide::up, CutSide::down, CutSide::slot}) {
      for (const double ae : {0.5e-3, 3e-3, 8e-3}) {
        const auto slices = straight_slices(flat, side, ae, 2e-3);
        const Engagement e = straight_engagement(flat, side, ae, 2e-3);
        const Vec3 mean = mean_force(flat, m, e, kFeed);
        EXPECT_LT((mean_force(flat, m, slices, kFeed) - mean).norm(), 1e-12 * mean.norm());
        const ForceHistory a = force_history(flat, m, slices, kFeed), b = force_history(flat, m, {e}, kFeed);
        ASSERT_EQ(a.force.size(), b.force.size());
        for (std::size_t k = 0; k < a.force.size(); ++k)
          EXPECT_LT((a.force[k] - b.force[k]).norm(), 1e-12 * b.peak.norm());
      }
    }
  }
}

// A corner radius that goes to 0 goes to the flat cutter.
TEST(Rounded, SmallRadiiGoToTheFlatCutter) {
  const Material m = samples::aluminium();
  const Engagement e{0, kPi, 2e-3};
  const Vec3 flat = mean_force(samples::end_mill(), m, e, kFeed);
  double before = 1;
  for (const double r : {1e-3, 1e-4, 1e-5}) {
    const Cutter cutter = rounded(r);
    const double off = (mean_force(cutter, m, straight_slices(cutter, CutSide::slot, 0, 2e-3), kFeed) - flat).norm();
    EXPECT_LT(off, before * flat.norm());
    before = off / flat.norm();
  }
  EXPECT_LT(before, 0.01);
}

// With K the angle up to which a ball of radius r cuts in a slot and N teeth, by integrals of sines over 0 .. K:
// int s = 1 - cos K, int c = sin K, int s^2 = K/2 - sin(2K)/4, int s c = sin(K)^2 / 2.
TEST(Rounded, BallInASlotIsTheClosedForm) {
  const Cutter ball = rounded(4e-3);
  const Material m = samples::aluminium();
  for (const double ap : {1e-6, 0.1e-3, 0.5e-3, 2e-3, 4e-3}) {
    SCOPED_TRACE(ap);
    const double r = ball.corner_radius, K = std::acos(1 - ap / r);
    const double S = 1 - std::cos(K), C = std::sin(K), SS = K / 2 - std::sin(2 * K) / 4, SC = C * C / 2;
    const Vec3 expected = ball.teeth / (2 * kPi) * r *
                          Vec3(-2 * (m.kre * S - m.kae * C) - kPi / 2 * kFeed * (m.krc * SS - m.kac * SC),
                               2 * m.kte * K + kPi / 2 * kFeed * m.ktc * S,
                               kPi * (m.kre * C + m.kae * S) + 2 * kFeed * (m.krc * SC + m.kac * SS));
    const Vec3 found = mean_force(ball, m, straight_slices(ball, CutSide::slot, 0, ap), kFeed);
    EXPECT_LT((found - expected).norm(), 1e-5 * expected.norm());
  }
}

// Deeper than the corner a cylinder stands on it.
TEST(Rounded, TheSideAddsToTheCorner) {
  const Cutter bull = rounded(1.5e-3);
  const Material m = samples::aluminium();
  const Vec3 corner = mean_force(bull, m, straight_slices(bull, CutSide::down, 3e-3, 1.5e-3), kFeed);
  const Vec3 whole = mean_force(bull, m, straight_slices(bull, CutSide::down, 3e-3, 4e-3), kFeed);
  Engagement side = straight_engagement(bull, CutSide::down, 3e-3, 2.5e-3);
  EXPECT_LT((whole - corner - mean_force(bull, m, side, kFeed)).norm(), 1e-12 * whole.norm());
}

TEST(Rounded, IsTheSumOverThePointsOfTheSurface) {
  const Material m = samples::aluminium();
  for (const double r : {1e-3, 4e-3}) {
    const Cutter cutter = rounded(r);
    for (const double ap : {0.3e-3, 5e-3}) {
      for (const CutSide side : {CutSide::up, CutSide::down, CutSide::slot}) {
        for (const double ae : {1e-3, 6.5e-3}) {
          if (side == CutSide::slot && ae > 1e-3) continue;  // a slot has no width of its own
          SCOPED_TRACE(::testing::Message() << r << " " << ap << " " << static_cast<int>(side) << " " << ae);
          const double wall = cutter.radius() - ae;
          const Vec3 expected = by_points(cutter, m, ap, [&](const Vec3& p) {
            return side == CutSide::slot || (side == CutSide::up ? p.y() >= wall : -p.y() >= wall);
          });
          const Vec3 found = mean_force(cutter, m, straight_slices(cutter, side, ae, ap), kFeed);
          // Points on the wall's face: 1 in 2000 of each direction; where nothing is met both are 0.
          EXPECT_LT((found - expected).norm(), 3e-3 * expected.norm() + 1e-6);
        }
      }
    }
  }
}

// A thin slice at the tip of a ball is pushed up by the edge's radial force alone: kappa is 0, and so is the chip.
TEST(Rounded, TheTipOfABallIsPushedUp) {
  const Cutter ball = rounded(4e-3);
  Material m = samples::aluminium();
  m.kae = 0;
  const double ap = 1e-9, length = ball.corner_radius * std::acos(1 - ap / ball.corner_radius);
  const Vec3 found = mean_force(ball, m, straight_slices(ball, CutSide::slot, 0, ap), kFeed);
  EXPECT_NEAR(found.z(), ball.teeth / 2.0 * length * m.kre, 1e-3 * found.z());
}

TEST(Rounded, TheHistoryHasTheMean) {
  const Material m = samples::aluminium();
  for (const double r : {2e-3, 4e-3}) {
    const Cutter cutter = rounded(r);
    for (const CutSide side : {CutSide::up, CutSide::down, CutSide::slot}) {
      const auto slices = straight_slices(cutter, side, 3e-3, 3e-3);
      const Vec3 mean = mean_force(cutter, m, slices, kFeed);
      EXPECT_LT((force_history(cutter, m, slices, kFeed).mean - mean).norm(), 1e-3 * mean.norm());
    }
  }
}

TEST(Rounded, RadiusOverTheHeight) {
  const Cutter bull = rounded(1e-3);
  EXPECT_NEAR(radius_at(bull, 0), 3e-3, 1e-15);
  EXPECT_NEAR(radius_at(bull, 1e-3 * (1 - std::cos(kPi / 6))), 3.5e-3, 1e-12);
  for (const double z : {1e-5, 2e-4, 7e-4, 1e-3}) EXPECT_NEAR(edge_height(bull, radius_at(bull, z)), z, 1e-12);
  EXPECT_EQ(edge_height(bull, 2e-3), 0);
  EXPECT_TRUE(std::isinf(edge_height(bull, 1.001 * bull.radius())));
  EXPECT_EQ(radius_at(bull, 1e-3), 4e-3);
  EXPECT_EQ(radius_at(samples::end_mill(), 0), 4e-3);
}

}  // namespace
}  // namespace polypod::cutting
