// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A calibration from 100 measured points, an identification from 90.
#include <benchmark/benchmark.h>

#include "polypod/calibration/calibrate.hpp"
#include "polypod/calibration/simulate.hpp"

namespace {

using namespace polypod;

/// machine: 0 strut hexapod, 1 hexapod on rails, 2 LOLA 50
void calibrate_100_points(benchmark::State& state) {
  static constexpr const char* kNames[] = {"hexapod-strut", "hexapod-slider", "lola50"};
  const auto nominal = *machine::load(kNames[state.range(0)]);
  const auto truth = *calibration::perturbed(nominal, 0.1e-3, 1e-3, 7);
  calibration::SimulationOptions how;
  how.count = 100;
  const auto rows = *calibration::simulate(nominal, truth, how);
  for (auto _ : state) {
    const auto result = calibration::calibrate(nominal, rows);
    if (!result) state.SkipWithError(to_string(result.error()).c_str());
  }
}
BENCHMARK(calibrate_100_points)->Arg(0)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond);

/// Poses of a strut hexapod: how the time grows with the rows.
void calibrate_poses(benchmark::State& state) {
  const auto nominal = *machine::load("hexapod-strut");
  const auto truth = *calibration::perturbed(nominal, 0.1e-3, 1e-3, 7);
  calibration::SimulationOptions how;
  how.count = static_cast<std::size_t>(state.range(0));
  how.kind = calibration::Kind::pose;
  const auto rows = *calibration::simulate(nominal, truth, how);
  for (auto _ : state) {
    const auto result = calibration::calibrate(nominal, rows);
    if (!result) state.SkipWithError(to_string(result.error()).c_str());
  }
}
BENCHMARK(calibrate_poses)->Arg(100)->Arg(1000)->Arg(10000)->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime();

void identify_90_points(benchmark::State& state) {
  const auto m = *machine::load("lola50");
  calibration::SimulationOptions how;
  how.count = 90;
  how.noise_position = 5e-6;
  const auto points = *calibration::simulate_displacements(m, 250, how);
  for (auto _ : state) {
    const auto result = statics::identify_compliance(m, points);
    if (!result) state.SkipWithError(to_string(result.error()).c_str());
  }
}
BENCHMARK(identify_90_points)->Unit(benchmark::kMillisecond);

}  // namespace
