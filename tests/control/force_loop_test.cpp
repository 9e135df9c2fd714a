// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The components of the on-line correction in LinuxCNC, run here without it: the force component against
// OnlineCorrector, the played machine against the prediction; and which settings are refused.
#include "polypod/control/force_loop.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <limits>
#include <numeric>

#include "machining/examples.hpp"
#include "module_host.hpp"
#include "polypod/core/random.hpp"
#include "polypod/core/units.hpp"
#include "polypod/cutting/force.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod::control {
namespace {

constexpr long kPeriod_ns = 1000000;
constexpr double kPeriod = 1e-3;
#define POLYPOD_NEEDS_HALCOMPILE \
  ASSERT_TRUE(test::has_linuxcnc()) << "scripts/install-packages test brings LinuxCNC and its headers"

/// One side of the square, so that a loop is found in seconds.
testing::Example one_side() {
  return testing::with_program("slavkovic_square",
                               "%\nG17 G21 G40 G49 G80 G90 G94\nG54\nT1 M6\nS8000 M3\nG0 X-135 Y125 Z10\nG0 Z2\n"
                               "G1 Z-2 F400\nG1 X-60 Y125 F1600\nG0 Z10\nM5\nM30\n%\n");
}
/// Of that side with 20 ms of delay; made once.
const ForceLoop& loop_of_one_side() {
  static const ForceLoop loop = [] {
    const auto e = one_side();
    OnlineOptions options;
    options.sensor.delay = 20e-3;
    return testing::unwrap(force_loop(e.job, e.program, e.interpretation, options, OnlineMethod::both));
  }();
  return loop;
}

std::string written(const test::Folder& folder, const std::string& name, const std::string& text) {
  const auto file = folder.path() / (name + ".comp");
  std::ofstream(file) << text;
  return test::compiled_component(file).string();
}
void set_xyz(test::ModuleHost& host, const std::string& name, const Vec3& v) {
  for (int k = 0; k < 3; ++k) host.set(fmt::format("{}-{}", name, "xyz"[k]), v[k]);
}
Vec3 xyz(const test::ModuleHost& host, const std::string& name) {
  return {host.pin(name + "-x"), host.pin(name + "-y"), host.pin(name + "-z")};
}
void set_compliance(test::ModuleHost& host, const Mat3& C) {
  for (int i = 0; i < 3; ++i)
    for (int k = i; k < 3; ++k)
      host.set(fmt::format("compliance-{}{}", "xyz"[i], "xyz"[k]), units::to_um_per_N(C(i, k)));
}
const Mat3& some_compliance() {
  static const Mat3 C = (Mat3() << 2.2e-6, 0.3e-6, -0.1e-6, 0.3e-6, 1.4e-6, 0.2e-6, -0.1e-6, 0.2e-6, 0.9e-6).finished();
  return C;
}

// Cycle by cycle the shift is that of OnlineCorrector, which `polypod online` simulates: while the force changes, while
// it is no number for a moment, and when it stays away.
TEST(ForceLoop, TheComponentShiftsAsTheSimulatedController) {
  POLYPOD_NEEDS_HALCOMPILE;
  const test::Folder folder;
  test::ModuleHost host(written(folder, "some_force", force_component("some")));
  ASSERT_EQ(host.loaded, 0);
  OnlineLimits limits;
  limits.cutoff = 25;
  limits.rate = 3e-3;
  OnlineCorrector corrector(limits, 60, kPeriod);
  set_compliance(host, some_compliance());
  host.set("machine-is-on", 1);
  host.set("weight", 60);
  host.set("cutoff", limits.cutoff);
  host.set("shift-limit", units::to_um(limits.size));
  host.set("shift-rate", units::to_um(limits.rate));
  host.set("hold", limits.hold);
  Random random(7);
  Vec3 force(0, 0, -60);
  const Vec3 expected(3, -40, 2);
  double largest = 0;
  const auto step = [&](const Vec3& reading) {
    set_xyz(host, "sensor", reading);
    set_xyz(host, "expected", expected);
    host.set("heartbeat", host.pin("heartbeat") + 1);
    host.run("some-force", kPeriod_ns);
    const Vec3 shift = corrector.step(reading, expected, some_compliance());
    largest = std::max(largest, shift.norm());
    return (units::to_um(1) * shift - xyz(host, "shift")).norm();
  };
  constexpr double kSame = 1e-9;  // um
  for (int k = 0; k < 400; ++k) {
    if (k % 50 == 0) force = Vec3(120 * random.normal(), 60 * random.normal(), -60 + 20 * random.normal());
    ASSERT_LT(step(force), kSame) << k;
    EXPECT_EQ(host.pin("lost"), 0);
  }
  const Vec3 broken(0, std::numeric_limits<double>::quiet_NaN(), 0);
  const Vec3 held = xyz(host, "shift");
  for (int k = 0; k < 60; ++k) {
    ASSERT_LT(step(broken), kSame) << k;
    EXPECT_EQ(xyz(host, "shift"), held);
    EXPECT_EQ(host.pin("lost"), 1);
    EXPECT_EQ(host.pin("error"), 0);
  }
  for (int k = 0; k < 100; ++k) ASSERT_LT(step(force), kSame) << k;
  EXPECT_FALSE(corrector.tripped());
  for (int k = 0; k < 400; ++k) {
    ASSERT_LT(step(broken), kSame) << k;
    EXPECT_EQ(host.pin("error") != 0, corrector.tripped()) << k;
  }
  EXPECT_TRUE(corrector.tripped());
  EXPECT_EQ(xyz(host, "shift").norm(), 0);
  for (int k = 0; k < 50; ++k) ASSERT_LT(step(force), kSame);  // it stays so
  EXPECT_EQ(host.pin("error"), 1);
  EXPECT_GT(largest, 100e-6);
  // Until the machine is switched off and on.
  host.set("machine-is-on", 0);
  step(force);
  EXPECT_EQ(host.pin("error"), 0);
  host.set("machine-is-on", 1);
  for (int k = 0; k < 400; ++k) step(force);
  EXPECT_EQ(host.pin("error"), 0);
  EXPECT_GT(xyz(host, "shift").norm(), 1);
}

// A source that stopped leaves finite numbers behind; it trips all the same. So does a shift beyond its limit. Neither
// does where the correction is off.
TEST(ForceLoop, TheWatchdogTripsOnASourceThatStoppedAndOnALimit) {
  POLYPOD_NEEDS_HALCOMPILE;
  for (const bool limit : {false, true}) {
    for (const bool on : {true, false}) {
      const test::Folder folder;
      test::ModuleHost host(written(folder, "some_force", force_component("some")));
      set_compliance(host, some_compliance());
      host.set("machine-is-on", 1);
      host.set("on", on ? 1 : 0);
      host.set("shift-limit", limit ? 50 : 500);
      host.set("sensor-x", 100);
      int tripped = 0;
      double before = 0, largest = 0, steepest = 0;
      for (int k = 1; k <= 600; ++k) {
        if (limit || k < 200) host.set("heartbeat", k);
        host.run("some-force", kPeriod_ns);
        if (tripped == 0 && host.pin("error") != 0) tripped = k;
        const double now = xyz(host, "shift").norm();
        largest = std::max(largest, now);
        steepest = std::max(steepest, std::abs(now - before));
        before = now;
      }
      EXPECT_LE(steepest, 10 * (1 + 1e-9));  // 10000 um/s
      if (!on) {
        EXPECT_EQ(tripped, 0);
        EXPECT_EQ(largest, 0);
        continue;
      }
      // 199 is the last beat; the limit is passed some ms after the beginning.
      if (limit) {
        EXPECT_NEAR(tripped, 105, 5);
      } else {
        EXPECT_EQ(tripped, 199 + 101);
      }
      EXPECT_LE(largest, (limit ? 50 : 500) * (1 + 1e-9));
      EXPECT_EQ(before, 0);  // faded
    }
  }
}

// On the path and beside it the force is that of the straight cut in closed form, and with it the machine bends nearly
// as `predict` says.
TEST(ForceLoop, TheTableIsTheStraightCut) {
  const auto e = one_side();
  const ForceLoop& loop = loop_of_one_side();
  const auto prediction = testing::predict(e);
  statics::Probe probe(e.job.machine, Mat3::Identity());
  machining::Spread bent;
  const double feed = 1600e-3 / 60;
  const cutting::Cutter& cutter = e.job.cutter_of(1);
  const auto closed = [&](double ae) {
    return cutting::mean_force(cutter, e.job.material,
                               cutting::straight_engagement(cutter, cutting::CutSide::down, ae, 2e-3), 0.05e-3);
  };
  constexpr double kWide = 4e-3, kAside = 0.3e-3;
  const Vec3 on = closed(kWide);
  // The tool to the left of its way is farther from the wall, which lies to the right.
  const Vec3 off = (closed(kWide - kAside) - closed(kWide)) / kAside;
  for (std::size_t i = 0; i + 1 < loop.path.size(); ++i) {
    const PathForce& f = loop.path[i];
    if (f.ends || f.edge.isZero() || f.p_M.x() < -0.11) continue;  // behind the entry
    Mat3 C;
    ASSERT_TRUE(probe.at(f.p_M, C));
    const Vec3 d = (loop.path[i + 1].p_M - f.p_M).normalized(), n(-d.y(), d.x(), 0);
    const Vec3 F = f.edge + feed * f.chip, G = f.edge_off + feed * f.chip_off;
    const Vec3 T = f.edge_turned + feed * f.chip_turned;
    EXPECT_LT((F - on).norm(), 0.01 * on.norm());
    // Differences over 0.3 mm in a stock of cells.
    EXPECT_NEAR(G.y(), off.y(), 0.4 * std::abs(off.y()));
    // Where the way turns away from the wall there is less to cut.
    EXPECT_LT(n.dot(T), 0);
    // The corrected program is made for the force on the path.
    EXPECT_NEAR(f.corrected.y(), on.y(), 0.05 * on.norm());
    bent.add(n.dot(C * F) / (1 - n.dot(C * G)));
  }
  ASSERT_GT(bent.count, 80U);
  // Of these cells `predict` sees less of the width that a deflected tool loses: it has 276 um, the closed form 266 um.
  EXPECT_NEAR(bent.mean, prediction.normal.mean, 0.07 * prediction.normal.mean);
}

TEST(ForceLoop, ThePlayedMachineAndItsSensor) {
  POLYPOD_NEEDS_HALCOMPILE;
  const test::Folder folder;
  const ForceLoop& loop = loop_of_one_side();
  test::ModuleHost host(written(folder, "some_cut", cut_component("some", loop)));
  ASSERT_EQ(host.loaded, 0);
  const Mat3 C = 2e-6 * Mat3::Identity();
  set_compliance(host, C);
  constexpr int kDelay = 7, kCycles = 2400;
  host.set("delay", kDelay);
  host.set("weight", 60);
  host.set("corrected", 1);
  host.set("force-factor", 1.2);
  const double feed = 1600.0 / 60;  // mm/s
  const Vec3 start =
      units::to_mm(1) * (one_side().job.X_MW * Vec3(units::from_mm(-135), units::from_mm(125), units::from_mm(-2)));
  std::vector<Vec3> cut, expected;
  double worst = 0;
  for (int k = 0; k < kCycles; ++k) {
    set_xyz(host, "command", start + feed * kPeriod * k * Vec3::UnitX());
    host.run("cut", kPeriod_ns);
    host.run("expected", kPeriod_ns);
    cut.push_back(xyz(host, "cut"));
    EXPECT_EQ(host.pin("heartbeat"), k + 1);
    if (k >= kDelay) {
      EXPECT_LT((xyz(host, "sensor") + Vec3(0, 0, 60) - cut[static_cast<std::size_t>(k - kDelay)]).norm(), 1e-12);
    }
    if (k < 1000) continue;
    // In balance: the error is that of the force.
    EXPECT_EQ(host.pin("cutting"), 1);
    worst = std::max(worst, std::abs(std::abs(host.pin("error")) - 2 * std::abs(cut.back().y())));
    expected.push_back(xyz(host, "expected"));
  }
  EXPECT_LT(worst, 1e-9);
  // What the corrected program is made for: the force on the path, without the factor and without the bending.
  const double bent = cut.back().y(), meant = expected.back().y();
  EXPECT_GT(std::abs(meant), 80);
  EXPECT_LT(std::abs(bent), 1.25 * std::abs(meant));
  EXPECT_GT(std::abs(bent), std::abs(meant));
  // Faults.
  host.set("no-number", 1);
  host.run("cut", kPeriod_ns);
  EXPECT_TRUE(std::isnan(host.pin("sensor-y")));
  host.set("no-number", 0);
  host.set("stopped", 1);
  const double beat = host.pin("heartbeat");
  host.run("cut", kPeriod_ns);
  EXPECT_EQ(host.pin("heartbeat"), beat);
  host.set("stopped", 0);
  // Far from the path, nothing is cut, and the noise is as large as it should be.
  set_xyz(host, "command", start + Vec3(0, 0, 50));
  host.set("noise", 2);
  for (int k = 0; k < 100; ++k) host.run("cut", kPeriod_ns);
  double sum = 0, squares = 0;
  constexpr int kCount = 4000;
  for (int k = 0; k < kCount; ++k) {
    host.run("cut", kPeriod_ns);
    sum += host.pin("sensor-x");
    squares += host.pin("sensor-x") * host.pin("sensor-x");
  }
  EXPECT_EQ(xyz(host, "cut").norm(), 0);
  EXPECT_NEAR(sum / kCount, 0, 5 * 2 / std::sqrt(kCount));
  EXPECT_NEAR(std::sqrt(squares / kCount), 2, 0.1);
}

// Both components wired as in the exported configuration: the loop that they close swings where its margin is below 1,
// and settles where it is above.
TEST(ForceLoop, TheClosedLoopSwingsWhereTheMarginSaysSo) {
  POLYPOD_NEEDS_HALCOMPILE;
  const ForceLoop& loop = loop_of_one_side();
  const PathForce& middle = loop.path[2 * loop.path.size() / 3];
  const double feed = 1600e-3 / 60, model = 2.5e-6, delay = 10e-3;
  constexpr double kSofter = 0.3;  // the real compliance over the model's: the shift is too large
  OnlineLoop linear{kSofter * model, model, -(middle.edge_off + feed * middle.chip_off).y(),
                    -(middle.edge_turned + feed * middle.chip_turned).y() / feed};
  ASSERT_GT(linear.cut_damping, 0);
  ForceSensor sensor;
  sensor.delay = delay + kLinuxcncDelay;
  const auto gain = [&](double cutoff) {
    OnlineLimits limits;
    limits.cutoff = cutoff;
    return online_margin(linear, sensor, limits, kPeriod).gain;
  };
  double low = 1, high = 400;
  ASSERT_GT(gain(low), 1);
  ASSERT_LT(gain(high), 1);
  for (int k = 0; k < 8; ++k) {
    const double between = std::sqrt(low * high);
    (gain(between) > 1 ? low : high) = between;
  }
  /// How far the error goes to and fro in the last 0.4 s, um.
  const auto swing = [&](double cutoff) {
    const test::Folder folder;
    test::ModuleHost force(written(folder, "some_force", force_component("some")));
    test::ModuleHost cut(written(folder, "some_cut", cut_component("some", loop)));
    for (test::ModuleHost* host : {&force, &cut}) set_compliance(*host, model * Mat3::Identity());
    force.set("machine-is-on", 1);
    force.set("cutoff", cutoff);
    force.set("shift-limit", 5000);
    force.set("shift-rate", 1e7);
    cut.set("delay", std::round(delay / kPeriod));
    cut.set("compliance-factor", kSofter);
    const Vec3 start = units::to_mm(1) * (one_side().job.X_MW * Vec3(-0.135, 0.125, -2e-3));
    double least = 1e9, most = -1e9;
    for (int k = 0; k < 2600; ++k) {
      set_xyz(cut, "command", start + units::to_mm(feed) * kPeriod * k * Vec3::UnitX());
      set_xyz(cut, "force", xyz(force, "force"));
      cut.run("cut", kPeriod_ns);
      set_xyz(force, "sensor", xyz(cut, "sensor"));
      force.set("heartbeat", cut.pin("heartbeat"));
      force.run("some-force", kPeriod_ns);
      if (k < 2200) continue;
      least = std::min(least, cut.pin("error"));
      most = std::max(most, cut.pin("error"));
    }
    return most - least;
  };
  EXPECT_LT(swing(0.8 * low), 5) << low;
  EXPECT_GT(swing(1.25 * low), 50) << low;
}

// Beyond the margin it is refused, and what the hint says would do does.
TEST(ForceLoop, SettingsBeyondTheMarginAreRefusedWithWhatWouldDo) {
  const auto e = one_side();
  OnlineOptions options;
  options.sensor.delay = 20e-3;
  options.limits.cutoff = 200;
  const auto refused = force_loop(e.job, e.program, e.interpretation, options, OnlineMethod::online);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().id, "LC131");
  const std::string hint = refused.error().hint;
  const auto number_behind = [&](const std::string& option) {
    const auto at = hint.find(option);
    EXPECT_NE(at, std::string::npos) << hint;
    return at == std::string::npos ? 0.0 : std::stod(hint.substr(at + option.size()));
  };
  OnlineOptions better = options;
  better.limits.cutoff = number_behind("--cutoff-hz ");
  EXPECT_GT(better.limits.cutoff, 10);
  const auto taken = force_loop(e.job, e.program, e.interpretation, better, OnlineMethod::online);
  ASSERT_TRUE(taken) << to_string(taken.error());
  EXPECT_GE(taken->margin.gain, options.least_margin);
  // Without on-line correction there is nothing to refuse.
  EXPECT_TRUE(force_loop(e.job, e.program, e.interpretation, options, OnlineMethod::offline));
  // Where the shift at rest is too much already, neither low-pass nor delay helps.
  options.least_margin = 50;
  const auto never = force_loop(e.job, e.program, e.interpretation, options, OnlineMethod::both);
  ASSERT_FALSE(never);
  EXPECT_EQ(never.error().id, "LC131");
  EXPECT_THAT(never.error().hint, ::testing::HasSubstr("no low-pass and no delay"));
}

}  // namespace
}  // namespace polypod::control
