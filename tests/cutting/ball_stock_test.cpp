// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cutting/ball_stock.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "ball_by_points.hpp"
#include "polypod/cutting/turned_block.hpp"
#include "samples.hpp"

namespace polypod::cutting {
namespace {

using samples::by_points;
using samples::kPi;

constexpr double kR = 4e-3, kFeed = 5e-5, kCell = 0.16e-3, kAhead = 0.32e-3;

Cutter ball(int teeth = 2) {
  Cutter cutter = samples::end_mill(teeth);
  cutter.corner_radius = cutter.radius();
  return cutter;
}

Stock block(double cell = kCell) {
  return *Stock::block({-20e-3, -12e-3, -12e-3}, {20e-3, 12e-3, 0}, cell);
}

Vec3 found(const Stock& stock, const Vec3& tip, const Vec3& d) {
  BallEngagement engagement;
  look_ahead(stock, tip, kR, d, kAhead, engagement);
  return BallForce(ball(), samples::aluminium()).mean_force(engagement, d, kFeed);
}

// The section of a groove is the segment of a circle; its ends are parts of the ball that lie outside of the block.
TEST(BallStock, AGrooveHasTheSectionOfACircle) {
  for (const double ap : {0.5e-3, 1.5e-3, 3.5e-3}) {
    Stock s = block();
    const double removed = cut_ball(s, {-30e-3, 0.3e-3, -ap}, {30e-3, 0.3e-3, -ap}, kR);
    const double half = std::acos(1 - ap / kR), section = kR * kR * (half - std::sin(half) * std::cos(half));
    EXPECT_NEAR(removed, 40e-3 * section, 0.01 * removed);
    EXPECT_NEAR(40e-3 * 24e-3 * 12e-3 - s.volume(), removed, 1e-4 * removed);
  }
}

// Over the middle of every cell the lowest of many places of the ball on its way.
TEST(BallStock, AStepIsTheLowestOfItsPlaces) {
  const Vec3 ways[][2] = {{{-5e-3, -3e-3, -1e-3}, {6e-3, 4e-3, -1e-3}},
                          {{-5e-3, -3e-3, -0.2e-3}, {6e-3, 4e-3, -3e-3}},
                          {{2e-3, 1e-3, -3e-3}, {-1e-3, 2e-3, 1e-3}},
                          {{1e-3, 1e-3, 2e-3}, {1e-3, 1e-3, -2e-3}},
                          {{0, 0, -0.5e-3}, {0.05e-3, 0, -0.6e-3}}};
  for (const auto& way : ways) {
    Stock s = block(0.4e-3);
    cut_ball(s, way[0], way[1], kR);
    for (int j = 0; j < s.rows(); ++j) {
      for (int i = 0; i < s.columns(); ++i) {
        const double x = s.x_min() + (i + 0.5) * s.cell(), y = s.y_min() + (j + 0.5) * s.cell();
        double lowest = 0;  // the block's top
        constexpr int kPlaces = 4000;
        for (int k = 0; k <= kPlaces; ++k) {
          const Vec3 tip = way[0] + double(k) / kPlaces * (way[1] - way[0]);
          const double under = kR * kR - std::pow(x - tip.x(), 2) - std::pow(y - tip.y(), 2);
          if (under > 0) lowest = std::min(lowest, tip.z() + kR - std::sqrt(under));
        }
        EXPECT_NEAR(s.height(i, j), lowest, 2e-6) << x << " " << y;
      }
    }
  }
}

TEST(BallStock, AWayThatIsRunAgainMeetsNothing) {
  Stock s = block();
  const Vec3 a(-15e-3, -3e-3, -0.7e-3), b(12e-3, 5e-3, -2.2e-3), d = (b - a).normalized();
  cut_ball(s, a, b, kR);
  constexpr double kRounding = 1e-14;  // m^3: a nanometre of height over the way
  EXPECT_LT(cut_ball(s, a, b, kR), kRounding);
  double steps = 0;
  for (int k = 0; k < 50; ++k) steps += cut_ball(s, a + k / 50.0 * (b - a), a + (k + 1) / 50.0 * (b - a), kR);
  EXPECT_LT(steps, 1e-12);
  for (int k = 1; k < 40; ++k) {
    BallEngagement engagement;
    look_ahead(s, a + k / 50.0 * (b - a), kR, d, kAhead, engagement);
    EXPECT_FALSE(engagement.any) << k;
  }
}

TEST(BallStock, AGrooveHasTheForceOfTheClosedForm) {
  for (const double ap : {0.3e-3, 1e-3, 2.5e-3, 4e-3, 5.5e-3}) {
    for (const double angle : {0.0, 0.3, 1.1}) {
      SCOPED_TRACE(::testing::Message() << ap << " at " << angle);
      Stock s = block();
      const Vec3 d(std::cos(angle), std::sin(angle), 0), tip(0.1e-3, 0.05e-3, -ap);
      cut_ball(s, tip - 0.04 * d, tip, kR);
      const Vec3 expected =
          mean_force(ball(), samples::aluminium(), straight_slices(ball(), CutSide::slot, 0, ap), kFeed);
      const Vec3 f = found(s, tip, d);
      const Vec3 turned(expected.x() * d.x() - expected.y() * d.y(), expected.x() * d.y() + expected.y() * d.x(),
                        expected.z());
      EXPECT_LT((f - turned).norm(), 0.03 * expected.norm());
    }
  }
}

// Straight down into a plane: the ring of the ball that is in it, by points.
TEST(BallStock, APlungeIsASphereInAPlane) {
  for (const double depth : {0.5e-3, 1.5e-3}) {
    Stock s = block();
    const Vec3 tip(0.1e-3, 0.05e-3, -depth), d(0, 0, -1);
    cut_ball(s, tip, tip, kR);
    const Vec3 expected =
        by_points(ball(), samples::aluminium(), d, kFeed, [&](const Vec3& p) { return p.z() < depth; });
    EXPECT_NEAR(expected.head<2>().norm(), 0, 1e-9 * expected.norm());
    EXPECT_LT((found(s, tip, d) - expected).norm(), 0.03 * expected.norm());
  }
}

// Ramps down and up through the top of the block.
TEST(BallStock, RampsAreTheSumOverPoints) {
  for (const double slope_deg : {-35.0, -15.0, -5.0, 8.0, 20.0}) {
    SCOPED_TRACE(slope_deg);
    const double slope = slope_deg * kPi / 180;
    const Vec3 d(std::cos(slope), 0, std::sin(slope)), tip(0.1e-3, 0.05e-3, -1.2e-3);
    Stock s = block();
    cut_ball(s, tip - 15e-3 * d, tip, kR);
    const Vec3 expected =
        by_points(ball(), samples::aluminium(), d, kFeed, [&](const Vec3& p) { return p.z() < 1.2e-3; });
    // Where the ball climbs steeply, what it looks at ahead stands higher than what it cuts here.
    EXPECT_LT((found(s, tip, d) - expected).norm(), (slope_deg > 10 ? 0.08 : 0.04) * expected.norm());
  }
}

// What lies before a way, of what lies on all sides, has the force of that way.
TEST(BallStock, ContactsAddUpToTheForceOfAWay) {
  const BallForce force(ball(), samples::aluminium());
  const double down = 20 * kPi / 180;
  for (const Vec3& d : {Vec3(1, 0, 0), Vec3(0.6, 0.8, 0), Vec3(std::cos(down), 0, -std::sin(down)), Vec3(0, 0, -1)}) {
    Stock s = block();
    const Vec3 tip(0.1e-3, 0.2e-3, -1.7e-3);
    cut_ball(s, tip - 5e-3 * d, tip, kR);
    std::vector<BallContact> contacts;
    force.contacts(s, tip, kAhead, contacts);
    Vec3 sum = Vec3::Zero();
    for (const BallContact& c : contacts) {
      const double chip = kFeed * c.n.dot(d);
      if (chip > 0 && c.gap < kAhead / 4) sum += c.edge + chip * c.chip;
    }
    const Vec3 expected = found(s, tip, d);
    EXPECT_LT((sum - expected).norm(), 0.06 * expected.norm()) << sum.transpose() << " and " << expected.transpose();
  }
}

// The next line of a plane, beside a groove: what stands between the ball and the groove's own cylinder.
TEST(BallStock, ALineBesideAGroove) {
  for (const double step : {1e-3, 2e-3, -1.5e-3}) {
    SCOPED_TRACE(step);
    constexpr double kAp = 1e-3;
    Stock s = block();
    cut_ball(s, {-30e-3, 0, -kAp}, {30e-3, 0, -kAp}, kR);
    const Vec3 tip(0.1e-3, step, -kAp), d(1, 0, 0);
    cut_ball(s, {-30e-3, step, -kAp}, tip, kR);
    const Vec3 expected = by_points(ball(), samples::aluminium(), d, kFeed, [&](const Vec3& p) {
      const double y = p.y() + step, under = kR * kR - y * y;
      const double groove = under > 0 ? kR - std::sqrt(under) : kAp;
      return p.z() < std::min(kAp, groove);
    });
    EXPECT_LT((found(s, tip, d) - expected).norm(), 0.05 * expected.norm());
  }
}

// --- A tool that leans: what the ball takes is the same, and other parts of its edges take it.

Mat3 leaning(double forwards_deg, double sideways_deg) {
  return rotation_y(forwards_deg * kPi / 180) * rotation_x(sideways_deg * kPi / 180);
}

Vec3 found(const Stock& stock, const Vec3& lowest, const Mat3& R, const Vec3& d) {
  BallEngagement engagement;
  look_ahead(stock, lowest, R, kR, d, kAhead, engagement);
  for (const float side : engagement.side) EXPECT_EQ(side, 0);
  return BallForce(ball(), samples::aluminium()).mean_force(engagement, R, d, kFeed);
}

TEST(LeaningBall, UprightItIsTheOtherFunction) {
  for (const double ap : {0.3e-3, 1.5e-3, 3.5e-3}) {
    for (const Vec3& way : {Vec3(1, 0, 0), Vec3(0.6, 0.8, 0), Vec3(-0.9, 0.3, 0)}) {
      const Vec3 d = way.normalized(), tip(0.1e-3, 0.05e-3, -ap);
      Stock s = block();
      cut_ball(s, tip - 0.01 * d, tip, kR);
      BallEngagement a, b;
      look_ahead(s, tip, kR, d, kAhead, a);
      look_ahead(s, tip, Mat3::Identity(), kR, d, kAhead, b);
      const BallForce force(ball(), samples::aluminium());
      const Vec3 one = force.mean_force(a, d, kFeed), other = force.mean_force(b, Mat3::Identity(), d, kFeed);
      EXPECT_GT(one.norm(), 10);
      EXPECT_LT((one - other).norm(), 0.03 * one.norm()) << one.transpose() << " and " << other.transpose();
      EXPECT_NEAR(a.max_depth, b.max_depth, 1e-6);
    }
  }
}

TEST(LeaningBall, GroovesAndRampsAreTheSumOverPoints) {
  for (const double slope_deg : {0.0, -10.0, 5.0}) {
    for (const auto& lean : {std::array{15.0, 0.0}, std::array{-15.0, 0.0}, std::array{0.0, 30.0},
                             std::array{30.0, -20.0}, std::array{50.0, 10.0}}) {
      SCOPED_TRACE(::testing::Message() << slope_deg << " at " << lean[0] << ", " << lean[1]);
      const Mat3 R = leaning(lean[0], lean[1]);
      const double slope = slope_deg * kPi / 180, ap = 0.8e-3;
      const Vec3 d(std::cos(slope), 0, std::sin(slope)), lowest(0.1e-3, 0.05e-3, -ap);
      Stock s = block();
      cut_ball(s, lowest - 15e-3 * d, lowest, kR);
      // What it looks at lies ahead, where a ball that climbs stands higher.
      const double there = std::min(ap, ap - kAhead * d.z());
      const Vec3 expected =
          by_points(ball(), samples::aluminium(), R, d, kFeed, [&](const Vec3& p) { return p.z() < there; });
      const Vec3 f = found(s, lowest, R, d);
      EXPECT_LT((f - expected).norm(), 0.05 * expected.norm()) << f.transpose() << " for " << expected.transpose();
    }
  }
}

// The same as a block that is seen along the tool: its top is a slope there, which no ring of the ball follows.
// Finishing cuts take a few rings alone: they lost up to a quarter of their force.
TEST(LeaningBall, ABlockSeenAlongTheToolIsTheSumOverPoints) {
  for (const double ap : {0.1e-3, 0.2e-3, 1e-3}) {
    for (const auto& lean : {std::array{5.0, 0.0}, std::array{20.0, 0.0}, std::array{-20.0, 0.0}, std::array{0.0, 20.0},
                             std::array{40.0, 10.0}}) {
      SCOPED_TRACE(::testing::Message() << 1e3 * ap << " mm at " << lean[0] << ", " << lean[1]);
      const Mat3 R_SW = leaning(lean[0], lean[1]).transpose();
      const Vec3 up = R_SW.col(2), d = R_SW * Vec3(1, 0, 0);
      Stock s = *turned_block({-20e-3, -12e-3, -12e-3}, {20e-3, 12e-3, 0}, R_SW, 0.08e-3);
      const Vec3 tip = R_SW * Vec3(0.1e-3, 0.05e-3, kR - ap) - kR * Vec3::UnitZ();
      cut_ball(s, tip - 15e-3 * d, tip, kR);
      const Vec3 expected =
          by_points(ball(), samples::aluminium(), d, kFeed, [&](const Vec3& p) { return (tip + p).dot(up) < 0; });
      const Vec3 f = found(s, tip, d);
      // The shallowest meets eight rings, of which those at its border are known to a third.
      EXPECT_LT((f - expected).norm(), (ap < 0.15e-3 ? 0.08 : 0.05) * expected.norm())
          << f.transpose() << " for " << expected.transpose();
    }
  }
}

// The tip of an upright ball, where the edges stand still, rubs; leaning lifts it out of the floor.
TEST(LeaningBall, LeaningChangesTheForce) {
  const Vec3 d(1, 0, 0), lowest(0.1e-3, 0.05e-3, -0.5e-3);
  Stock s = block();
  cut_ball(s, lowest - 15e-3 * d, lowest, kR);
  const Vec3 upright = found(s, lowest, d), leaned = found(s, lowest, leaning(30, 0), d);
  EXPECT_GT((upright - leaned).norm(), 0.2 * upright.norm());
}

TEST(LeaningBall, AWayThatIsRunAgainMeetsNothing) {
  Stock s = block();
  const Vec3 a(-15e-3, -3e-3, -0.7e-3), b(12e-3, 5e-3, -1.2e-3), d = (b - a).normalized();
  cut_ball(s, a, b, kR);
  for (int k = 1; k < 40; ++k) {
    BallEngagement engagement;
    look_ahead(s, a + k / 50.0 * (b - a), leaning(25, -15), kR, d, kAhead, engagement);
    EXPECT_FALSE(engagement.any) << k;
  }
}

TEST(LeaningBall, ContactsAddUpToTheForceOfAWay) {
  constexpr double kTouches = 5e-6;  // m: beyond the top of the block contacts are before material, not in it
  constexpr double kCoarse = 0.11;   // 16 rings, of which one more or less is in the block
  const BallForce force(ball(), samples::aluminium());
  for (const Mat3& R : {leaning(20, 0), leaning(-20, 25), leaning(0, 45)}) {
    for (const Vec3& d : {Vec3(1, 0, 0), Vec3(0.6, 0.8, 0), Vec3(std::cos(0.2), 0, -std::sin(0.2))}) {
      Stock s = block();
      const Vec3 lowest(0.1e-3, 0.2e-3, -0.9e-3);
      cut_ball(s, lowest - 5e-3 * d, lowest, kR);
      std::vector<BallContact> contacts;
      force.contacts(s, lowest, R, kAhead, contacts);
      Vec3 sum = Vec3::Zero();
      for (const BallContact& c : contacts) {
        const double chip = kFeed * c.n.dot(d);
        if (chip > 0 && c.gap < kTouches) sum += c.edge + chip * c.chip;
      }
      const Vec3 expected =
          by_points(ball(), samples::aluminium(), R, d, kFeed, [&](const Vec3& p) { return p.z() < -lowest.z(); });
      EXPECT_LT((sum - expected).norm(), kCoarse * expected.norm())
          << sum.transpose() << " and " << expected.transpose();
    }
  }
}

// How the tool is turned about its own axis is nothing to the force.
TEST(LeaningBall, ATurnAboutTheAxisIsNothing) {
  const BallForce force(ball(), samples::aluminium());
  for (const double ap : {1e-3, 3e-3, 5e-3}) {
    for (const double slope_deg : {0.0, -34.0}) {
      const double slope = slope_deg * kPi / 180;
      const Vec3 d(std::cos(slope), 0, std::sin(slope)), lowest(0.1e-3, 0.05e-3, -ap);
      const Mat3 R = leaning(30, 15);
      Stock s = block();
      for (int k = 0; k < 20; ++k) {
        const Vec3 a = lowest - (20 - k) * 0.5e-3 * d, b = a + 0.5e-3 * d;
        cut_ball(s, a, b, kR);
        cut_shaft(s, a, b, R.col(2), kR, 20e-3);
      }
      BallEngagement engagement;
      look_ahead(s, lowest, R, kR, d, kAhead, engagement);
      const Vec3 one = force.mean_force(engagement, R, d, kFeed);
      for (const double turn : {0.3, 1.6, 4.0}) {
        const Mat3 turned = R * rotation_z(turn);
        look_ahead(s, lowest, turned, kR, d, kAhead, engagement);
        const Vec3 other = force.mean_force(engagement, turned, d, kFeed);
        EXPECT_LT((one - other).norm(), 0.02 * one.norm()) << ap << ": " << one.transpose() << " " << other.transpose();
      }
    }
  }
}

// The straight part above the ball, where it leans over the block.
TEST(LeaningBall, TheSideIsSeen) {
  Stock s = block();
  const Vec3 d(1, 0, 0), lowest(0.1e-3, 0.05e-3, -3e-3);
  cut_ball(s, lowest - 15e-3 * d, lowest, kR);
  const auto side = [&](double forwards) {
    BallEngagement engagement;
    look_ahead(s, lowest, leaning(forwards, 0), kR, d, kAhead, engagement);
    return *std::max_element(engagement.side.begin(), engagement.side.end());
  };
  EXPECT_EQ(side(-20), 0);  // it leans back over what it has cut
  EXPECT_GT(side(45), 0.5e-3);
}

// The straight part takes what a sum over spheres along its axis takes, and after that it meets only what lies ahead.
TEST(LeaningBall, TheShaftIsTheLowestOfItsPlaces) {
  const Mat3 R = leaning(40, 10);
  const Vec3 a(-3e-3, 1e-3, -3e-3), b(-2e-3, 1.3e-3, -3.1e-3);
  Stock s = block(0.4e-3), spheres = s;
  EXPECT_GT(cut_shaft(s, a, b, R.col(2), kR, 20e-3), 0);
  for (int k = 0; k <= 10; ++k)
    for (int along = 0; along <= 2000; ++along) {
      const Vec3 lowest = a + k / 10.0 * (b - a) + along * 10e-6 * R.col(2);
      if (lowest.z() < 0) cut_ball(spheres, lowest, lowest, kR);
    }
  const double half = 0.5 * s.cell();
  int compared = 0;
  for (int j = 0; j < s.rows(); ++j)
    for (int i = 0; i < s.columns(); ++i) {
      // Spheres reach beyond the cylinder at its lower end, below the plane through the middle of the ball.
      const Vec3 w = Vec3(s.x_min() + i * s.cell() + half, s.y_min() + j * s.cell() + half, spheres.height(i, j)) - a -
                     kR * Vec3::UnitZ();
      if (w.dot(R.col(2)) < 1.2e-3 || spheres.height(i, j) > -0.05e-3) continue;
      ++compared;
      EXPECT_NEAR(s.height(i, j), spheres.height(i, j), 20e-6);
    }
  EXPECT_GT(compared, 20);
  EXPECT_LT(cut_shaft(s, a, b, R.col(2), kR, 20e-3), 1e-14);  // m^3: heights are kept in single precision
  EXPECT_EQ(cut_shaft(s, a, b, Vec3::UnitZ(), kR, 20e-3), 0);
}

TEST(BallStock, AirAndForeignPlacesMeetNothing) {
  const Stock s = block();
  BallEngagement engagement;
  look_ahead(s, {0, 0, 1e-6}, kR, {1, 0, 0}, kAhead, engagement);
  EXPECT_FALSE(engagement.any);
  look_ahead(s, {0.1, 0, -1e-3}, kR, {1, 0, 0}, kAhead, engagement);
  EXPECT_FALSE(engagement.any);
  EXPECT_TRUE(BallForce(ball(), samples::aluminium()).mean_force(engagement, {1, 0, 0}, kFeed).isZero(0));
}

}  // namespace
}  // namespace polypod::cutting
