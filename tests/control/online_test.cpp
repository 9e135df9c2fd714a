// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The margin against the loop itself, run in time; the controller's limits; the loop of the square against `predict`.
#include "polypod/control/online.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <deque>
#include <limits>

#include "machining/examples.hpp"
#include "polypod/core/units.hpp"

namespace polypod::control {
namespace {

constexpr double kPeriod = 1e-3;

/// Runs x = c + u + C F, F = F0 - K x - B dx/dt with the shift of OnlineCorrector, from a shift of 1 um on; how much
/// larger the swing of its last fifth is than that of the second.
double growth(const OnlineLoop& loop, const ForceSensor& sensor, OnlineLimits limits, int cycles) {
  limits.size = limits.rate = 1e100;  // linear
  OnlineCorrector corrector(limits, 0, kPeriod);
  const Mat3 C_model = loop.model_compliance * Mat3::Identity();
  std::deque<double> line(static_cast<std::size_t>(std::lround(sensor.delay / kPeriod)), 0.0);
  const double stiffness = loop.cut_stiffness + loop.cut_damping / kPeriod;
  double x = 0, u = 0, early = 0, late = 0;
  for (int k = 0; k < cycles; ++k) {
    const double push = k < 3 ? 1e-6 : 0;
    // x = push + u + C F, F = -K x - B (x - x_before) / T
    const double x_now =
        (push + u + loop.compliance * loop.cut_damping / kPeriod * x) / (1 + loop.compliance * stiffness);
    const double f = -loop.cut_stiffness * x_now - loop.cut_damping * (x_now - x) / kPeriod;
    x = x_now;
    line.push_back(f);
    u = corrector.step(Vec3(line.front(), 0, 0), Vec3::Zero(), C_model).x();
    line.pop_front();
    if (k >= cycles / 5 && k < 2 * cycles / 5) early = std::max(early, std::abs(x));
    if (k >= 4 * cycles / 5) late = std::max(late, std::abs(x));
  }
  return late / std::max(early, 1e-300);
}

TEST(Online, TheMarginIsWhereTheLoopInTimeBeginsToGrow) {
  struct Case {
    double C, K, B, delay, cutoff;
  };
  for (const Case& c : {Case{2.5e-6, 15e3, 1.2e3, 5e-3, 20}, Case{2.5e-6, 15e3, 1.2e3, 20e-3, 20},
                        Case{2.5e-6, 15e3, 1.2e3, 20e-3, 200}, Case{5e-6, 400e3, 0, 0, 50},
                        Case{5e-6, -60e3, 2e3, 10e-3, 100}, Case{1e-6, 2e6, 500, 3e-3, 10}}) {
    ForceSensor sensor;
    sensor.delay = c.delay;
    OnlineLimits limits;
    limits.cutoff = c.cutoff;
    OnlineLoop loop{c.C, c.C, c.K, c.B};
    const OnlineMargin margin = online_margin(loop, sensor, limits, kPeriod);
    ASSERT_TRUE(std::isfinite(margin.gain));
    // The worst growth of all delays up to the sensor's.
    const auto worst = [&] {
      double out = 0;
      for (ForceSensor s = sensor; s.delay > -0.5 * kPeriod; s.delay -= kPeriod)
        out = std::max(out, growth(loop, s, limits, 4000));
      return out;
    };
    loop.model_compliance = 0.97 * margin.gain * c.C;
    EXPECT_LT(worst(), 1) << c.K << " " << c.delay;
    EXPECT_GT(online_margin(loop, sensor, limits, kPeriod).gain, 1);
    loop.model_compliance = 1.03 * margin.gain * c.C;
    EXPECT_GT(worst(), 1) << c.K << " " << c.delay;
    EXPECT_LT(online_margin(loop, sensor, limits, kPeriod).gain, 1);
  }
}

// At standstill L = C_m K / (1 + C K), and no delay matters there.
TEST(Online, AStiffCutWithoutDampingHasItsMarginInClosedForm) {
  const OnlineLoop loop{2e-6, 3e-6, 100e3, 0};
  const OnlineMargin margin = online_margin(loop, {}, {}, kPeriod);
  EXPECT_NEAR(margin.gain, (1 + 0.2) / 0.3, 1e-9);
  EXPECT_EQ(margin.frequency, 0);
  EXPECT_TRUE(std::isinf(margin.delay));  // a loop below 1 everywhere bears any delay
  EXPECT_NEAR(margin.largest, 0.25, 1e-9);
}

// Just stable without a delay, where the loop's gain is largest beside the frequency at which it would swing; a delay
// brings that frequency there.
TEST(Online, TheDelayThatMakesItUnstable) {
  OnlineLoop loop{2e-6, 2e-6, 0, 1e3};
  OnlineLimits limits;
  limits.cutoff = 80;
  ForceSensor sensor;
  sensor.delay = 0;
  loop.model_compliance *= online_margin(loop, sensor, limits, kPeriod).gain / 1.01;
  const OnlineMargin margin = online_margin(loop, sensor, limits, kPeriod);
  EXPECT_NEAR(margin.gain, 1.01, 1e-3);
  EXPECT_GT(margin.largest, 1);
  ASSERT_TRUE(std::isfinite(margin.delay));
  ASSERT_GE(margin.delay, 2 * kPeriod);
  sensor.delay = margin.delay - kPeriod;
  EXPECT_LT(growth(loop, sensor, limits, 4000), 1);
  EXPECT_GT(online_margin(loop, sensor, limits, kPeriod).gain, 1);
  sensor.delay = margin.delay;
  EXPECT_GT(growth(loop, sensor, limits, 4000), 1);
  EXPECT_LT(online_margin(loop, sensor, limits, kPeriod).gain, 1);
}

TEST(Online, LostForcesHoldThenFadeAndTrip) {
  OnlineLimits limits;
  limits.cutoff = 50;
  OnlineCorrector c(limits, 60, kPeriod);
  const Mat3 C = 2e-6 * Mat3::Identity();
  const Vec3 weight(0, 0, -60);
  for (int k = 0; k < 2000; ++k) {
    const Vec3 before = c.shift();
    c.step(Vec3(100, 0, 0) + weight, Vec3::Zero(), C);
    EXPECT_LE((c.shift() - before).norm(), limits.rate * kPeriod * (1 + 1e-12));
  }
  EXPECT_LT((c.shift() - Vec3(-200e-6, 0, 0)).norm(), 1e-9);
  const Vec3 held = c.shift();
  for (int k = 0; k < 100; ++k) EXPECT_EQ(c.step({}, Vec3::Zero(), C), held);
  EXPECT_FALSE(c.tripped());
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (int k = 0; k < 30; ++k) c.step(Vec3(nan, 0, 0), Vec3::Zero(), C);
  EXPECT_TRUE(c.tripped());
  EXPECT_EQ(c.shift().norm(), 0);
  c.step(Vec3(100, 0, 0), Vec3::Zero(), C);  // it stays so
  EXPECT_EQ(c.shift().norm(), 0);
}

TEST(Online, AShiftBeyondItsLimitTrips) {
  OnlineLimits limits;
  limits.size = 50e-6;
  OnlineCorrector c(limits, 0, kPeriod);
  for (int k = 0; k < 500 && !c.tripped(); ++k) {
    c.step(Vec3(100, 0, 0), Vec3::Zero(), 2e-6 * Mat3::Identity());
    EXPECT_LE(c.shift().norm(), limits.size * (1 + 1e-12));
  }
  EXPECT_TRUE(c.tripped());
}

/// One side of the square, so that a run has some thousand cycles.
testing::Example one_side() {
  return testing::with_program("slavkovic_square",
                               "%\nG17 G21 G40 G49 G80 G90 G94\nG54\nT1 M6\nS8000 M3\nG0 X-135 Y125 Z10\nG0 Z2\n"
                               "G1 Z-2 F400\nG1 X-60 Y125 F1600\nG0 Z10\nM5\nM30\n%\n");
}

TEST(Online, WithoutCorrectionItIsThePrediction) {
  const auto e = one_side();
  OnlineOptions options;
  const auto r = simulate_online(e.job, e.program, e.interpretation, options);
  ASSERT_TRUE(r) << to_string(r.error());
  const auto p = testing::predict(e);
  ASSERT_EQ(r->outcomes.size(), 4U);
  // The balance of a prediction against the tool that follows in cycles: a few um of 270 along the side, and where the
  // cut begins the tool of the loop comes later.
  EXPECT_NEAR(r->outcomes[0].normal.mean, p.normal.mean, 0.03 * p.normal.mean);
  EXPECT_NEAR(r->outcomes[0].normal.max, p.normal.max, 0.03 * p.normal.max);
  EXPECT_EQ(r->outcomes[0].largest_shift, 0);
}

// Stable for delays up to 20 ms, and better than none; refused where the margin is less than asked for.
TEST(Online, ADelayOf20msIsBorne) {
  const auto e = one_side();
  OnlineOptions options;
  options.sensor.delay = 20e-3;
  options.real_force = 1.2;
  const auto r = simulate_online(e.job, e.program, e.interpretation, options);
  ASSERT_TRUE(r) << to_string(r.error());
  ASSERT_TRUE(r->stable_enough);
  for (const OnlineOutcome& one : r->outcomes) {
    EXPECT_FALSE(one.refused);
    EXPECT_FALSE(one.stopped) << *one.stopped;
  }
  const auto& [none, offline, online, both] = std::tie(r->outcomes[0], r->outcomes[1], r->outcomes[2], r->outcomes[3]);
  // Off-line leaves the fifth by which the forces are larger.
  EXPECT_NEAR(offline.normal.mean, 0.2 / 1.2 * none.normal.mean, 0.05 * none.normal.mean);
  EXPECT_LT(online.rms, 0.5 * none.rms);
  EXPECT_LT(both.rms, offline.rms);
  options.least_margin = 100;
  const auto refused = simulate_online(e.job, e.program, e.interpretation, options);
  ASSERT_TRUE(refused);
  EXPECT_FALSE(refused->stable_enough);
  EXPECT_TRUE(refused->outcomes[2].refused);
  EXPECT_TRUE(refused->outcomes[3].refused);
}

}  // namespace
}  // namespace polypod::control
