// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The ladder of turns about the tool axis along a path: `post --config six --c free`.
#include <benchmark/benchmark.h>

#include <cmath>
#include <numbers>
#include <stdexcept>

#include "choice.hpp"
#include "polypod/families/serial/machine.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/post/plan.hpp"

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

/// On `rail` m of rail along y of M, if above 0.
post::Configuration milling_robot(double rail) {
  auto machine = machine::load("kuka-kr210");
  if (!machine) throw std::runtime_error(to_string(machine.error()));
  auto& arm = std::get<machine::SerialArm>(*machine);
  arm.X_FT = arm.X_FT * Pose{rotation_y(std::numbers::pi / 2), {0.3, 0, -0.2}};
  for (machine::DhRow& row : arm.dh) row.compliance = 1e-6;
  if (rail > 0) {
    machine::DhRow row;
    row.kind = machine::JointKind::prismatic;
    row.theta_offset = std::numbers::pi / 2;
    row.range = {0, rail};
    arm.dh.front().alpha = -std::numbers::pi / 2;
    arm.dh.insert(arm.dh.begin(), row);
    arm.X_MB = {rotation_y(std::numbers::pi / 2), Vec3::Zero()};
  }
  auto configuration = post::configure(*machine, "six");
  if (!configuration) throw std::runtime_error(to_string(configuration.error()));
  return *configuration;
}

/// The first posture that serves.
void run(benchmark::State& state, const post::Configuration& six, post::PlanOptions options, bool every_point) {
  const post::Path path = path_of(static_cast<int>(state.range(0)));
  options.origin = {1.4, 0.2, 0.6};
  options.joint_speeds.assign(static_cast<std::size_t>(kinematics::joint_count(six.machine)), 2.0);
  post::ChoiceQuestion question;
  question.every_point = every_point;
  while (question.branch < 7 && !std::isfinite(post::first_look(six, path, options, question))) ++question.branch;
  for (auto _ : state) {
    const post::Choice chosen = post::choose(six, path, options, question);
    if (!chosen.found) state.SkipWithError("no way");
    benchmark::DoNotOptimize(chosen.c.data());
  }
}

/// 72 values of C at every point.
void ladder_of_turns(benchmark::State& state) {
  post::PlanOptions options;
  options.c.reset();
  run(state, milling_robot(0), options, true);
}
BENCHMARK(ladder_of_turns)->Arg(10000)->Unit(benchmark::kMillisecond);

/// C and the place of a rail, where the tip has gone a 200th of the links.
void ladder_of_turns_and_rail(benchmark::State& state) {
  post::PlanOptions options;
  options.c.reset();
  options.external = post::External::chosen;
  run(state, milling_robot(4), options, false);
}
BENCHMARK(ladder_of_turns_and_rail)->Arg(10000)->Unit(benchmark::kMillisecond);

}  // namespace
