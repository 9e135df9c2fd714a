// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The seed's cell: an hour of its cycle, its motions, its bodies, and layouts scored. Run from the root of the project.
#include <benchmark/benchmark.h>

#include "polypod/cell/layout.hpp"
#include "polypod/cell/planning.hpp"
#include "polypod/cell/simulate.hpp"

namespace {

using namespace polypod::cell;

const Cell& seeds_cell() {
  static const Cell kCell = *read("cells/kozubik/cell.toml");
  return kCell;
}

void motions_of_the_cell(benchmark::State& state) {
  for (auto _ : state) benchmark::DoNotOptimize(motions(seeds_cell()));
}
BENCHMARK(motions_of_the_cell)->Unit(benchmark::kMillisecond);

void simulated_hour(benchmark::State& state) {
  const Motions m = motions(seeds_cell());
  RunSettings settings;
  settings.seconds = 3600;
  settings.policy = state.range(0) == 0 ? "first" : "look-ahead";
  for (auto _ : state) benchmark::DoNotOptimize(run(seeds_cell(), m, settings));
}
BENCHMARK(simulated_hour)->Arg(0)->Arg(1)->Unit(benchmark::kMillisecond);

void bodies_of_the_cell(benchmark::State& state) {
  const Motions m = motions(seeds_cell());
  for (auto _ : state) benchmark::DoNotOptimize(layout(seeds_cell(), m));
}
BENCHMARK(bodies_of_the_cell)->Unit(benchmark::kMillisecond);

void layouts_scored(benchmark::State& state) {
  FlowMatrix flows(8, 8);
  for (int i = 0; i < 8; ++i)
    for (int k = 0; k < 8; ++k) flows(i, k) = i == k ? 0 : (i * k) % 7;
  std::vector<Vec2> places;
  for (int i = 0; i < 8; ++i) places.emplace_back(i % 3, i / 3);
  for (auto _ : state) {
    std::rotate(places.begin(), places.begin() + 3, places.end());
    benchmark::DoNotOptimize(transport(flows, places));
  }
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK(layouts_scored);

}  // namespace
