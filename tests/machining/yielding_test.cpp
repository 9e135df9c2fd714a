// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A soft tool whose command turns away, against closed forms of linear cuts.
#include "polypod/machining/yielding.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

namespace polypod {
namespace {

using machining::ForceAlong;
using machining::yield_step;
using machining::Yielded;

constexpr int kDirections = 32;
constexpr double kSoftness = 1e-6;  // m/N
const Mat3 kC = kSoftness * Mat3::Identity();

Vec3 turned(const Eigen::Vector2d& d, double angle) {
  return {std::cos(angle) * d.x() - std::sin(angle) * d.y(), std::sin(angle) * d.x() + std::cos(angle) * d.y(), 0};
}

/// A cut that is the same in all directions: a force against the way, turned by `angle`.
std::vector<ForceAlong> linear_cut(double chip, double edge, double angle) {
  std::vector<ForceAlong> out;
  for (int j = 0; j < kDirections; ++j) {
    const double a = 2 * std::numbers::pi * j / kDirections;
    const Eigen::Vector2d d(std::cos(a), std::sin(a));
    out.push_back({d, -edge * turned(d, angle), -chip * turned(d, angle)});
  }
  return out;
}

/// The tip at the end of `steps` while the command goes evenly from `from` to `to` and `teeth` pass.
std::vector<Vec3> follow(const Vec3& tip, const Vec3& from, const Vec3& to, const std::vector<ForceAlong>& around,
                         double teeth, int steps) {
  std::vector<Vec3> out;
  Vec3 x = tip;
  for (int k = 1; k <= steps; ++k) {
    const Vec3 command = from + (to - from) * (double(k) / steps);
    x = yield_step(x, command, kC, around, teeth / steps).tip;
    out.push_back(x);
  }
  return out;
}

/// The tool lags behind by the bend delta at a feed of delta a unit of time; the command goes back by delta in the time
/// T. Then tau x' = c - x: the tool goes on by delta (1 - tau/T ln(1 + T/tau)) before it turns.
TEST(Yielding, AToolGoesOnAsTheLinearLagSays) {
  const double bend = 200e-6;
  for (const double share : {0.2, 1.0, 3.0}) {  // T / tau
    const double passes = 10 * share;           // ten teeth in tau: a chip of bend / 10
    const auto around = linear_cut(bend / kSoftness / (bend / 10), 0, 0);
    double farthest = 0;
    for (const Vec3& x : follow(Vec3::Zero(), {bend, 0, 0}, Vec3::Zero(), around, passes, 4000)) {
      farthest = std::max(farthest, x.x());
      EXPECT_NEAR(x.y(), 0, 1e-9);
    }
    EXPECT_NEAR(farthest, bend * (1 - std::log(1 + share) / share), 2e-3 * bend);
  }
}

/// With the force turned by phi the lag is complex, x' = e^(-i phi) (c - x) / tau: the tool also yields to the side.
TEST(Yielding, AForceAcrossTheWayTurnsTheToolAside) {
  using Complex = std::complex<double>;
  const double bend = 200e-6, phi = 1.0;
  const auto around = linear_cut(bend / kSoftness / (bend / 10), 0, phi);
  // In steady motion along x the bend is -bend e^(i phi): the command leads by its opposite.
  const Complex lead = std::polar(bend, phi);
  const int steps = 4000;
  const auto way = follow(Vec3::Zero(), {lead.real(), lead.imag(), 0}, Vec3::Zero(), around, 10, steps);
  // The linear equation in closed form, T = tau = 1.
  const Complex rate = std::polar(1.0, -phi);
  for (const int k : {steps / 4, steps / 2, steps}) {
    const double t = double(k) / steps;
    const Complex particular = lead * (1 - t + 1.0 / rate), start = lead * (1.0 + 1.0 / rate);
    const Complex x = particular - start * std::exp(-rate * t);
    EXPECT_NEAR(way[static_cast<std::size_t>(k - 1)].x(), x.real(), 5e-3 * bend) << t;
    EXPECT_NEAR(way[static_cast<std::size_t>(k - 1)].y(), x.imag(), 5e-3 * bend) << t;
  }
}

TEST(Yielding, TheEdgesHoldTheToolUntilTheCommandPullsHarder) {
  const double held = 50e-6;
  const auto around = linear_cut(0, held / kSoftness, 0);
  for (const double pull : {10e-6, 49e-6}) {
    const Yielded y = yield_step(Vec3::Zero(), {0.6 * pull, 0.8 * pull, -1e-3}, kC, around, 1);
    EXPECT_LT(y.tip.head<2>().norm(), 1e-12);
    EXPECT_NEAR(y.force.norm(), pull / kSoftness, 1e-2 * pull / kSoftness);
    EXPECT_NEAR(y.tip.z(), -1e-3, 1e-12);
  }
  const Yielded y = yield_step(Vec3::Zero(), {0.6 * 80e-6, 0.8 * 80e-6, 0}, kC, around, 1);
  EXPECT_NEAR(y.tip.head<2>().norm(), 30e-6, 0.3e-6);
}

TEST(Yielding, AirGivesTheToolToItsCommand) {
  const auto around = linear_cut(0, 0, 0);
  const Yielded y = yield_step({1e-3, 2e-3, 0}, {0.9e-3, 2.3e-3, 1e-3}, kC, around, 1);
  EXPECT_LT((y.tip - Vec3(0.9e-3, 2.3e-3, 1e-3)).norm(), 2e-6);
  EXPECT_TRUE(y.force.isZero());
}

/// A wall that pushes back across itself alone.
TEST(Yielding, AWallIsFollowed) {
  auto around = linear_cut(0, 0, 0);
  for (ForceAlong& f : around) f.chip = {0, -1e9 * std::max(0.0, f.d.y()), 0};
  const Yielded y = yield_step(Vec3::Zero(), {100e-6, 100e-6, 0}, kC, around, 1);
  EXPECT_NEAR(y.tip.x(), 100e-6, 1e-6);
  EXPECT_NEAR(y.tip.y(), 0, 1e-6);
}

}  // namespace
}  // namespace polypod
