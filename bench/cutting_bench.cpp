// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a point of a program costs in the cutting room: an 8 mm cutter, 40 cells over its diameter, steps of 0.5 mm.
#include <benchmark/benchmark.h>

#include <cmath>
#include <numbers>

#include "polypod/core/units.hpp"
#include "polypod/cutting/stock.hpp"

namespace {

using namespace polypod;
using namespace polypod::cutting;

Cutter end_mill() {
  return {"8 mm", units::from_mm(8), 4, units::from_deg(30), units::from_mm(20)};
}

Material aluminium() {
  Material m;
  m.ktc = units::from_N_per_mm2(1027.78);
  m.krc = units::from_N_per_mm2(182.03);
  m.kac = units::from_N_per_mm2(64.5);
  m.kte = units::from_N_per_mm(13.65);
  m.kre = units::from_N_per_mm(27.95);
  m.kae = units::from_N_per_mm(2.21);
  return m;
}

Stock plate(double cells_over_diameter) {
  return *Stock::block({-50e-3, -50e-3, -10e-3}, {50e-3, 50e-3, 0}, 8e-3 / cells_over_diameter);
}

void mean_force_closed_form(benchmark::State& state) {
  const Cutter cutter = end_mill();
  const Material material = aluminium();
  Engagement engagement = straight_engagement(cutter, CutSide::down, 4e-3, 2e-3);
  for (auto _ : state) {
    benchmark::DoNotOptimize(engagement);
    benchmark::DoNotOptimize(mean_force(cutter, material, engagement, 5e-5));
  }
}
BENCHMARK(mean_force_closed_form);

// Argument: direction in degrees.
void look_ahead_and_force(benchmark::State& state) {
  const Stock stock = plate(40);
  const ProfileForce force(end_mill(), aluminium());
  const double angle = units::from_deg(static_cast<double>(state.range(0)));
  const Eigen::Vector2d feed(std::cos(angle), std::sin(angle));
  EngagementProfile profile;
  double x = 0;
  for (auto _ : state) {
    x = x > 10e-3 ? -10e-3 : x + 0.5e-3;
    look_ahead(stock, {x, 1e-3, -2e-3}, 4e-3, feed, 2 * stock.cell(), profile);
    benchmark::DoNotOptimize(force.mean_force(profile, 5e-5));
  }
}
BENCHMARK(look_ahead_and_force)->Arg(0)->Arg(17)->Arg(45)->Arg(90);

void cut_line_step(benchmark::State& state) {
  Stock stock = plate(40);
  const double angle = units::from_deg(static_cast<double>(state.range(0)));
  const Vec3 step(0.5e-3 * std::cos(angle), 0.5e-3 * std::sin(angle), 0);
  constexpr int kSteps = 80;  // then a little deeper, so that there is always something to cut
  const Vec3 start = -0.5 * kSteps * step;
  Vec3 tip = start;
  int k = 0;
  double z = 0;
  for (auto _ : state) {
    if (k++ % kSteps == 0) {
      z = z < -9e-3 ? -1e-3 : z - 1e-6;
      tip = start + Vec3(0, 0, z);
    }
    const Vec3 next = tip + step;
    benchmark::DoNotOptimize(stock.cut_line(tip, next, 4e-3, true));
    tip = next;
  }
}
BENCHMARK(cut_line_step)->Arg(0)->Arg(17)->Arg(45)->Arg(90);

void cut_line_ramp_step(benchmark::State& state) {
  Stock stock = plate(40);
  double z = 0;
  for (auto _ : state) {
    z = z < -9e-3 ? 0 : z - 1e-6;
    benchmark::DoNotOptimize(stock.cut_line({0, 0, z}, {0.4e-3, 0.3e-3, z - 0.02e-3}, 4e-3, true));
  }
}
BENCHMARK(cut_line_ramp_step);

// A wavy way that goes up and down by a millimetre, or stays level; argument: whether it does. The steps of 0.25 mm are
// those of a pass.
void cut_wavy_steps(benchmark::State& state) {
  Stock stock = plate(40);
  const double height = state.range(0) != 0 ? 1e-3 : 0;
  constexpr double kStep = 0.25e-3, kLength = 80e-3;
  double s = 0, z = 0;
  const auto place = [&] {
    const double x = s - 0.5 * kLength;
    return Vec3(x, 5e-3 * std::sin(200 * x), z - 2e-3 + height * std::sin(400 * x));
  };
  Vec3 tip = place();
  for (auto _ : state) {
    s += kStep;
    if (s > kLength) {  // again, a little deeper
      s = 0;
      z = z < -5e-3 ? 0 : z - 1e-6;
      tip = place();
    }
    const Vec3 next = place();
    benchmark::DoNotOptimize(stock.cut_step(tip, next, 4e-3, true));
    tip = next;
  }
}
BENCHMARK(cut_wavy_steps)->ArgName("slope")->Arg(0)->Arg(1);

void force_history_by_discs(benchmark::State& state) {
  const Cutter cutter = end_mill();
  const Material material = aluminium();
  const Engagement engagement = straight_engagement(cutter, CutSide::down, 4e-3, 2e-3);
  for (auto _ : state) benchmark::DoNotOptimize(force_history(cutter, material, {engagement}, 5e-5));
}
BENCHMARK(force_history_by_discs);

}  // namespace
