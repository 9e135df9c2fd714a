// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Workspaces with bounds, and the plain scan beside them with its error.
#include <benchmark/benchmark.h>

#include "polypod/core/units.hpp"
#include "polypod/workspace/volume.hpp"

namespace {

using namespace polypod;

constexpr const char* kGeneral = R"(
family = "strut-hexapod"
base = { joints_mm = [[292,75,12],[-80,285,-10],[-210,215,5],[-214,-208,13],[-75,-293,-11],[286,-80,8]] }
platform = { joints_mm = [[108,102,-10],[40,148,8],[-146,36,4],[-140,-42,-6],[35,-142,9],[110,-104,-9]] }
leg = { length_min_mm = 400, length_max_mm = 600 }
joint = { limit = "cone", cone_deg = 45 }
tool = { length_mm = 80 }
)";

machine::AnyMachine machine_of(int which) {
  if (which == 1) return *machine::load("hexapod-slider");
  if (which == 2) return *machine::from_text(kGeneral, "general.toml");
  if (which == 3) return *machine::load("lola50");
  return *machine::load("hexapod-strut");
}

/// machine (0 strut, 1 slider, 2 general, 3 arm), tilt in deg, tolerance in 1e-4
void bounded(benchmark::State& state) {
  const auto m = machine_of(static_cast<int>(state.range(0)));
  workspace::Options options;
  options.directions.tilt = units::from_deg(static_cast<double>(state.range(1)));
  options.relative_tolerance = 1e-4 * static_cast<double>(state.range(2));
  workspace::Volume v;
  for (auto _ : state) v = *workspace::volume(m, options);
  state.counters["gap_ppm"] = 1e6 * (v.upper - v.lower) / v.volume;
  state.counters["boxes"] = static_cast<double>(v.points);
}
BENCHMARK(bounded)
    ->Args({0, 0, 10})
    ->Args({2, 0, 10})
    ->Args({0, 20, 100})
    ->Args({1, 0, 100})
    ->Args({1, 20, 100})
    ->Args({3, 0, 100})
    ->Args({3, 0, 10})
    ->Args({3, 20, 100})
    ->Unit(benchmark::kMillisecond);

/// The plain scan of the basic strut machine: steps a side; its error against the bounds.
void scan(benchmark::State& state) {
  const auto m = machine_of(0);
  workspace::Options options;
  options.relative_tolerance = 1e-3;
  const auto truth = *workspace::volume(m, options);
  double found = 0;
  for (auto _ : state) {
    found = workspace::scan_volume(m, options, truth.min, truth.max, static_cast<int>(state.range(0)));
  }
  state.counters["error_ppm"] = 1e6 * (found / truth.volume - 1);
}
BENCHMARK(scan)->Arg(30)->Arg(60)->Unit(benchmark::kMillisecond);

}  // namespace
