// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Quality maps. The peers: the search of JEL 5.3 that the source used, and Eigen's singular values.
#include <benchmark/benchmark.h>

#include <random>

#include "polypod/kinematics/any_machine.hpp"
#include "polypod/machine/any_machine.hpp"
#include "polypod/quality/survey.hpp"
#include "polypod/quality/zonotope.hpp"

namespace {

using namespace polypod;

quality::SurveyOptions options_of(int resolution, double tilt_deg = 20) {
  quality::SurveyOptions options;
  options.workspace.directions.tilt = tilt_deg * 3.14159265358979 / 180;
  options.resolution = resolution;
  return options;
}

/// JEL Table 8.2, all 78 elements, the workspace's points of a grid of 100 a side, 49 directions.
void tolerance_map(benchmark::State& state) {
  const auto m = *machine::load("hexapod-strut");
  const auto options = options_of(100);
  const auto survey = *quality::survey(m, options);
  const auto sizes = *quality::sized(m, {{"all", 0.01}}, true);
  for (auto _ : state) benchmark::DoNotOptimize(quality::tolerance_field(m, survey, options, sizes));
  state.counters["poses"] = static_cast<double>(survey.inside.size() * survey.orientations.size());
}
BENCHMARK(tolerance_map)->Unit(benchmark::kMillisecond)->UseRealTime();

/// The source's search on a grid of 12 a side: multiply by the poses to compare.
void tolerance_map_by_search(benchmark::State& state) {
  const auto m = *machine::load("hexapod-strut");
  const auto options = options_of(12);
  const auto survey = *quality::survey(m, options);
  const auto sizes = *quality::sized(m, {{"all", 0.01}}, true);
  for (auto _ : state) {
    benchmark::DoNotOptimize(
        quality::tolerance_field(m, survey, options, sizes, {quality::Method::search, quality::Region::box}));
  }
  state.counters["poses"] = static_cast<double>(survey.inside.size() * survey.orientations.size());
}
BENCHMARK(tolerance_map_by_search)->Unit(benchmark::kMillisecond)->UseRealTime();

void dexterity_map(benchmark::State& state) {
  const auto m = *machine::load("hexapod-strut");
  const auto options = options_of(100);
  const auto survey = *quality::survey(m, options);
  for (auto _ : state) benchmark::DoNotOptimize(quality::dexterity_field(m, survey, options));
  state.counters["poses"] = static_cast<double>(survey.inside.size() * survey.orientations.size());
}
BENCHMARK(dexterity_map)->Unit(benchmark::kMillisecond)->UseRealTime();

/// Surveys of machines that the kernel of six legs does not know; the time is that of one pose, on one thread.
void survey_of(benchmark::State& state, const char* name, bool tolerances) {
  const auto m = *machine::load(name);
  const auto sizes = tolerances ? *quality::sized(m, {{"all", 0.01}}, true) : std::vector<quality::Sized>();
  auto options = options_of(16, 0);
  options.workspace.threads = 1;
  const auto survey = *quality::survey(m, options);
  const auto poses = static_cast<double>(survey.inside.size() * survey.orientations.size());
  for (auto _ : state) {
    if (tolerances) {
      benchmark::DoNotOptimize(quality::tolerance_field(m, survey, options, sizes));
    } else {
      benchmark::DoNotOptimize(quality::dexterity_field(m, survey, options));
    }
  }
  state.counters["pose"] =
      benchmark::Counter(poses, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}
BENCHMARK_CAPTURE(survey_of, dexterity_arm, "lola50", false)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(survey_of, dexterity_rotary_delta, "delta-brno", false)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(survey_of, dexterity_linear_delta, "delta-linear", false)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(survey_of, tolerances_arm, "lola50", true)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(survey_of, tolerances_rotary_delta, "delta-brno", true)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(survey_of, tolerances_linear_delta, "delta-linear", true)->Unit(benchmark::kMillisecond);

/// One pose with Eigen's JacobiSVD.
void dexterity_by_svd(benchmark::State& state) {
  const auto m = *machine::load("hexapod-strut");
  const Pose X{rotation_x(0.1), Vec3(0.003, 0.004, 0.075)};
  const auto q = *quality::joints_at(m, X);
  for (auto _ : state) benchmark::DoNotOptimize(kinematics::dexterity(m, X, q));
}
BENCHMARK(dexterity_by_svd);

/// An arm of six rows and its 24 Denavit-Hartenberg tolerances: the columns of the closure, the farthest vertex of both
/// zonotopes.
void arm_tolerances(benchmark::State& state) {
  const auto m = *machine::from_text(R"(
family = "serial"
name = "six-axis"
task = "pose"
convention = "standard"
dh = [
  { a_mm = 75, alpha_deg = -90, d_mm = 335, theta_offset_deg = 0 },
  { a_mm = 270, alpha_deg = 0, d_mm = 0, theta_offset_deg = -90 },
  { a_mm = 90, alpha_deg = -90, d_mm = 0, theta_offset_deg = 0 },
  { a_mm = 0, alpha_deg = 90, d_mm = 295, theta_offset_deg = 0 },
  { a_mm = 0, alpha_deg = -90, d_mm = 0, theta_offset_deg = 0 },
  { a_mm = 0, alpha_deg = 0, d_mm = 80, theta_offset_deg = 180 },
]
limits = [
  { min_deg = -170, max_deg = 170 },
  { min_deg = -100, max_deg = 135 },
  { min_deg = -120, max_deg = 155 },
  { min_deg = -185, max_deg = 185 },
  { min_deg = -120, max_deg = 120 },
  { min_deg = -350, max_deg = 350 },
]
)",
                                     "six-axis.toml");
  machine::JointVector q(6);
  q << 0.3, -0.4, 0.5, 0.6, -0.7, 0.8;
  const Pose X = kinematics::forward(m, q).poses.front();
  const auto sizes = *quality::sized(m, {{"all", 0.01}}, true);
  const quality::WorstCaseAt worst_case(m, sizes);
  for (auto _ : state) benchmark::DoNotOptimize(worst_case(X, q));
  state.counters["elements"] = static_cast<double>(sizes.size());
}
BENCHMARK(arm_tolerances);

void farthest_vertex(benchmark::State& state) {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  std::vector<Vec3> g;
  for (int i = 0; i < state.range(0); ++i) g.emplace_back(normal(random), normal(random), normal(random));
  for (auto _ : state) benchmark::DoNotOptimize(quality::farthest_vertex(g));
}
BENCHMARK(farthest_vertex)->Arg(6)->Arg(24)->Arg(78);

}  // namespace
