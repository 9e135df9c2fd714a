// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Evaluations of candidates of a study, on one thread: the rate is the time of one that is judged whole, and of one
// that its coarse volume proves worse.
#include <benchmark/benchmark.h>
#include <fmt/format.h>

#include "polypod/design/evaluate.hpp"

namespace {

using namespace polypod;

/// The strut hexapod of JEL Table 8.2 at tilt 20 deg with one goal.
design::Study study_of(const char* figure, const char* sense) {
  return *design::study_from_text(
      fmt::format("machine = \"hexapod-strut\"\ntilt_deg = 20\n[[vary]]\nkey = \"base.radius_mm\"\nmin = 30\nmax = 60\n"
                  "[[goal]]\nfigure = \"{}\"\nsense = \"{}\"\n",
                  figure, sense),
      "bench.toml");
}

void evaluations(benchmark::State& state, const char* figure, const char* sense, double incumbent) {
  const design::Study study = study_of(figure, sense);
  const design::Incumbents beside{incumbent, {}};
  double radius = 40;
  for (auto _ : state) {
    radius = radius > 55 ? 40 : radius + 1;
    benchmark::DoNotOptimize(design::evaluate(study, {radius}, beside, {1, nullptr}));
  }
  state.SetItemsProcessed(state.iterations());
}

constexpr double kNothing = -1, kMuchBetter = 1e9;
BENCHMARK_CAPTURE(evaluations, volume_to_1_percent, "volume_mm3", "max", kNothing)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(evaluations, volume_proven_worse, "volume_mm3", "max", kMuchBetter)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(evaluations, tolerance, "tolerance_mm", "min", kNothing)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(evaluations, condition, "condition", "min", kNothing)->Unit(benchmark::kMillisecond);

}  // namespace
