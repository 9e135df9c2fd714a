// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cutting/discs.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "polypod/cutting/ball_stock.hpp"
#include "samples.hpp"

namespace polypod::cutting {
namespace {

using samples::kPi;

constexpr double kR = 4e-3, kFeed = 5e-5, kCell = 0.16e-3, kAhead = 0.32e-3;

Cutter bull_nose(double corner_radius) {
  Cutter cutter = samples::end_mill(2);
  cutter.corner_radius = corner_radius;
  return cutter;
}

Stock block(double cell = kCell) {
  return *Stock::block({-20e-3, -12e-3, -12e-3}, {20e-3, 12e-3, 0}, cell);
}

/// The force at `tip` on the way along d, level or sloped, in space.
Vec3 found(const Cutter& cutter, const Stock& stock, const Vec3& tip, const Vec3& d) {
  const DiscsForce force(cutter, samples::aluminium());
  const Eigen::Vector2d feed = d.head<2>().normalized();
  DiscsMet met;
  look_ahead(stock, tip, force.discs(), feed, kAhead, met);
  const Vec3 f = force.mean_force(met, kFeed * d.head<2>().norm(), kFeed * d.z());
  return {f.x() * feed.x() - f.y() * feed.y(), f.x() * feed.y() + f.y() * feed.x(), f.z()};
}

/// A cut of the full depth along x from the left end to `tip`.
void cut_up_to(Stock& stock, const Cutter& cutter, const Vec3& tip, const Vec3& d) {
  cut_line(stock, tip - 30e-3 * d, tip, discs_of(cutter));
}

/// The mean force of the corner and the side by a sum over points of them, N: h = max(0, s n . d). `met`: whether a
/// point, seen from the tip, is in material.
template <class Met>
Vec3 by_points(const Cutter& cutter, const Material& m, const Vec3& d, double top, Met&& met) {
  constexpr int kSteps = 500;
  const double r = cutter.corner_radius, flat = cutter.radius() - r;
  Vec3 sum = Vec3::Zero();
  const auto add = [&](double kappa, double rho, double z, double edge) {
    for (int j = 0; j < kSteps; ++j) {
      const double phi = 2 * kPi * (j + 0.5) / kSteps;
      const Vec3 out(std::sin(phi), std::cos(phi), 0);
      const Vec3 n = std::sin(kappa) * out - std::cos(kappa) * Vec3::UnitZ();
      const double h = kFeed * n.dot(d);
      if (!(h > 0) || !met(Vec3(rho * out + z * Vec3::UnitZ()))) continue;
      const Vec3 motion = out.cross(Vec3::UnitZ()), along = motion.cross(n);
      sum += edge * (-(m.kte + m.ktc * h) * motion - (m.kre + m.krc * h) * n + (m.kae + m.kac * h) * along);
    }
  };
  for (int i = 0; i < kSteps; ++i) {
    const double kappa = kPi / 2 * (i + 0.5) / kSteps;
    add(kappa, flat + r * std::sin(kappa), r * (1 - std::cos(kappa)), r * kPi / 2 / kSteps);
    if (top > r) add(kPi / 2, cutter.radius(), r + (i + 0.5) / kSteps * (top - r), (top - r) / kSteps);
  }
  return cutter.teeth / (2 * kPi) * (2 * kPi / kSteps) * sum;
}

TEST(Discs, OfAFlatCutterThereIsOne) {
  const std::vector<EdgeDisc> discs = discs_of(bull_nose(0));
  ASSERT_EQ(discs.size(), 1U);
  EXPECT_EQ(discs[0].z, 0);
  EXPECT_EQ(discs[0].radius, kR);
  EXPECT_EQ(discs[0].inner, kR);
  EXPECT_EQ(discs[0].kappa, kPi / 2);
}

TEST(Discs, AreAsWideAsTheCornerAndTouch) {
  const Cutter cutter = bull_nose(1.5e-3);
  const std::vector<EdgeDisc> discs = discs_of(cutter);
  ASSERT_EQ(discs.size(), kCornerDiscs + 1U);
  for (std::size_t i = 0; i + 1 < discs.size(); ++i) {
    EXPECT_NEAR(discs[i].z + discs[i].height, discs[i + 1].z, 1e-15);
    EXPECT_NEAR(radius_at(cutter, cutter.corner_radius * (1 - std::cos(discs[i].kappa))), discs[i].radius, 1e-15);
    EXPECT_EQ(discs[i + 1].inner, discs[i].radius);
  }
  EXPECT_NEAR(discs.back().z, 1.5e-3, 1e-15);
}

// The section of a groove: a flat floor, two quarters of a circle and the sides.
TEST(Discs, AGrooveHasTheSectionOfTheCutter) {
  for (const double r : {0.5e-3, 1.5e-3, 3.5e-3}) {
    for (const double ap : {0.4e-3, 1.2e-3, 4e-3}) {
      SCOPED_TRACE(::testing::Message() << r << " deep " << ap);
      const Cutter cutter = bull_nose(r);
      Stock s = block();
      const double removed = cut_line(s, {-30e-3, 0.3e-3, -ap}, {30e-3, 0.3e-3, -ap}, discs_of(cutter));
      double section = 0;
      constexpr int kSteps = 10000;
      for (int i = 0; i < kSteps; ++i) section += 2 * radius_at(cutter, ap * (i + 0.5) / kSteps) * ap / kSteps;
      EXPECT_NEAR(removed, 40e-3 * section, 0.015 * removed);
      EXPECT_NEAR(40e-3 * 24e-3 * 12e-3 - s.volume(), removed, 1e-4 * removed);
    }
  }
}

TEST(Discs, AWayThatIsRunAgainMeetsNothing) {
  const Cutter cutter = bull_nose(1e-3);
  const std::vector<EdgeDisc> discs = discs_of(cutter);
  Stock s = block();
  const Vec3 a(-15e-3, -3e-3, -0.7e-3), b(12e-3, 5e-3, -0.7e-3), d = (b - a).normalized();
  cut_line(s, a, b, discs);
  EXPECT_LT(cut_line(s, a, b, discs), 1e-14);
  for (int k = 1; k < 40; ++k) {
    DiscsMet met;
    look_ahead(s, a + k / 50.0 * (b - a), discs, d.head<2>(), kAhead, met);
    EXPECT_FALSE(met.any) << k;
  }
}

// Straight walls beside the cutter, whose force has a closed form (rounded.hpp, itself against published tables).
TEST(Discs, StraightCutsHaveTheForceOfTheClosedForm) {
  for (const double r : {0.4e-3, 1e-3, 2.5e-3, 4e-3}) {
    for (const double ap : {0.3e-3, 1e-3, 3e-3}) {
      for (const double ae : {0.0, 6e-3, 2.5e-3}) {  // 0: a slot
        SCOPED_TRACE(::testing::Message() << r << " deep " << ap << " wide " << ae);
        const Cutter cutter = bull_nose(r);
        const double angle = 0.3;
        const Vec3 d(std::cos(angle), std::sin(angle), 0), left(-d.y(), d.x(), 0), tip(0.1e-3, 0.05e-3, -ap);
        Stock s = block(0.1e-3);
        if (r == kR && ae > 0 && ap < 1e-3) continue;  // it grazes the wall
        // Down-milling: the material is to the right of the wall, and ends at R - ae to the right of the axis.
        if (ae > 0) {
          s.keep([&](double x, double y) { return (Vec3(x, y, 0) - tip).dot(left) < ae - kR; });
        }
        cut_up_to(s, cutter, tip, d);
        const Vec3 expected =
            mean_force(cutter, samples::aluminium(),
                       straight_slices(cutter, ae > 0 ? CutSide::down : CutSide::slot, ae, ap), kFeed);
        const Vec3 f = found(cutter, s, tip, d);
        const Vec3 turned(expected.x() * d.x() - expected.y() * d.y(), expected.x() * d.y() + expected.y() * d.x(),
                          expected.z());
        EXPECT_LT((f - turned).norm(), 0.04 * expected.norm()) << f.transpose() << " and " << turned.transpose();
      }
    }
  }
}

// A small corner is nearly none.
TEST(Discs, ASmallCornerIsThatOfAFlatCutter) {
  const Vec3 d(1, 0, 0), tip(0.1e-3, 0.05e-3, -2e-3);
  Vec3 force[2];
  for (const int i : {0, 1}) {
    const Cutter cutter = bull_nose(i * 1e-6);
    Stock s = block();
    cut_up_to(s, cutter, tip, d);
    force[i] = found(cutter, s, tip, d);
  }
  EXPECT_LT((force[1] - force[0]).norm(), 1e-3 * force[0].norm());
}

// What a ball's own engagement finds, with the corner as large as a ball's.
TEST(Discs, TheLargestCornerIsABall) {
  for (const double slope_deg : {0.0, 8.0, -5.0}) {
    SCOPED_TRACE(slope_deg);
    const double slope = slope_deg * kPi / 180;
    const Cutter cutter = bull_nose(kR);
    const Vec3 d(std::cos(slope), 0, std::sin(slope)), tip(0.1e-3, 0.05e-3, -1.2e-3);
    Stock s = block(), of_ball = block();
    cut_up_to(s, cutter, tip, d);
    cut_ball(of_ball, tip - 30e-3 * d, tip, kR);
    // On slopes the edges of the steps reach deeper than the corner.
    EXPECT_NEAR(s.volume(), of_ball.volume(), (slope != 0 ? 0.1 : 0.015) * (40e-3 * 24e-3 * 12e-3 - of_ball.volume()));
    BallEngagement engagement;
    look_ahead(of_ball, tip, kR, d, kAhead, engagement);
    const Vec3 expected = BallForce(cutter, samples::aluminium()).mean_force(engagement, d, kFeed);
    EXPECT_LT((found(cutter, s, tip, d) - expected).norm(), 0.05 * expected.norm());
  }
}

// Ways up and down through the top of the block, by points: the whole corner and the side, but for what is the end's on
// ways down (its rear where kappa is below the angle of the way).
TEST(Discs, RampsAreTheSumOverPoints) {
  for (const double r : {1e-3, 2.5e-3, 3.5e-3}) {
    for (const double slope_deg : {-10.0, -8.0, -3.0, 3.0, 10.0, 25.0}) {
      SCOPED_TRACE(::testing::Message() << r << " at " << slope_deg);
      const double slope = slope_deg * kPi / 180, descent = std::max(0.0, -slope);
      const Cutter cutter = bull_nose(r);
      const Vec3 d(std::cos(slope), 0, std::sin(slope)), tip(0.1e-3, 0.05e-3, -1.5e-3);
      Stock s = block();
      cut_line(s, tip - 15e-3 * d, tip, discs_of(cutter));
      const Vec3 expected = by_points(cutter, samples::aluminium(), d, 1.5e-3, [&](const Vec3& p) {
        const double kappa = std::asin(std::clamp((p.head<2>().norm() - (kR - r)) / r, 0.0, 1.0));
        return p.z() < 1.5e-3 && (p.x() > 0 || kappa > descent);
      });
      EXPECT_LT((found(cutter, s, tip, d) - expected).norm(), 0.05 * expected.norm());
    }
  }
}

// A plunge into a plane: the whole disc, as of a flat cutter.
TEST(Discs, APlungeHasTheWholeDiscBelowIt) {
  for (const double r : {0.0, 0.5e-3, 1.5e-3, 3e-3}) {
    const Cutter cutter = bull_nose(r);
    Stock s = block();
    const Vec3 tip(0.1e-3, 0.05e-3, -4e-3);
    cut_disc(s, tip, discs_of(cutter));
    EndFootprint footprint;
    look_down(s, tip, discs_of(cutter), kPi / 2, {1, 0}, 0.05e-3, footprint);
    EXPECT_NEAR(footprint.mean_length(), kR, 0.05 * kR) << r;  // each ring loses a part of a cell
    // On a level way and on a gentle ramp that of the flat end alone; above the floor nothing.
    look_down(s, tip, discs_of(cutter), 0.05, {1, 0}, 0.05e-3, footprint);
    EXPECT_NEAR(footprint.mean_length(), kR - r, 0.02 * kR) << r;
    look_down(s, tip + 0.06e-3 * Vec3::UnitZ(), discs_of(cutter), kPi / 2, {1, 0}, 0.05e-3, footprint);
    EXPECT_LT(footprint.mean_length(), 0.05 * kR) << r;
  }
}

}  // namespace
}  // namespace polypod::cutting
