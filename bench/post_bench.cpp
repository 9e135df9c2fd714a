// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The ladder of turns about the tool axis along a path: `post --config six --c free`.
#include <benchmark/benchmark.h>

#include <cmath>
#include <numbers>
#include <stdexcept>

#include "polypod/families/serial/machine.hpp"
#include "polypod/post/plan.hpp"
#include "turns.hpp"

namespace {

using namespace polypod;

post::Path path_of(int points) {
  post::Path path;
  for (int i = 0; i < points; ++i) {
    const double t = double(i) / points, a = 0.3 * std::sin(9 * t), b = 0.3 * std::cos(7 * t);
    post::Step step;
    step.kind = i == 0 ? post::StepKind::rapid : post::StepKind::line;
    step.line = i + 1;
    step.tip = {0.3 * t, 0.1 * std::sin(6 * t), 0.02 * std::cos(5 * t)};
    step.axis = Vec3(a, b, std::sqrt(1 - a * a - b * b));
    step.feed = 0.02;
    path.steps.push_back(step);
  }
  return path;
}

post::Configuration milling_robot() {
  auto machine = machine::load("kuka-kr210");
  if (!machine) throw std::runtime_error(to_string(machine.error()));
  auto& arm = std::get<machine::SerialArm>(*machine);
  arm.X_FT = arm.X_FT * Pose{rotation_y(std::numbers::pi / 2), {0.3, 0, -0.2}};
  for (machine::DhRow& row : arm.dh) row.compliance = 1e-6;
  auto configuration = post::configure(*machine, "six");
  if (!configuration) throw std::runtime_error(to_string(configuration.error()));
  return *configuration;
}

/// One posture, 72 values of C a point.
void ladder_of_turns(benchmark::State& state) {
  const post::Configuration six = milling_robot();
  const post::Path path = path_of(static_cast<int>(state.range(0)));
  post::PlanOptions options;
  options.origin = {1.4, 0.2, 0.6};
  options.joint_speeds.assign(6, 2.0);
  unsigned branch = 0;
  while (branch < 7 && !std::isfinite(post::first_look(six, path, options, branch))) ++branch;
  for (auto _ : state) {
    auto chosen = post::choose_c(six, path, options, branch, 0);
    if (chosen.c.empty()) state.SkipWithError("no way");
    benchmark::DoNotOptimize(chosen);
  }
}
BENCHMARK(ladder_of_turns)->Arg(10000)->Unit(benchmark::kMillisecond);

}  // namespace
