// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Predict, correct and check on short G1 lines, as 3D CAM output has them: lines a second on one core, from text to
// text.
#include <benchmark/benchmark.h>
#include <fmt/format.h>

#include <cmath>
#include <string>

#include "polypod/bodies/bodies.hpp"
#include "polypod/core/units.hpp"
#include "polypod/machining/check.hpp"
#include "polypod/machining/correct.hpp"

namespace {

using namespace polypod;

/// `lines` G1 lines of about 0.3 mm on passes along x with a wavy y, 1.5 mm apart, 1 mm deep; with `slopes` Z goes up
/// and down by another 0.3 mm, up to 7 deg steep.
std::string wavy_program(int lines, bool slopes) {
  std::string text = "G21 G90 G17 G94\nS12000 M3\nG0 X-60 Y-50 Z5\n";
  constexpr double kStep = 0.3, kWidth = 100;
  const int per_pass = static_cast<int>(kWidth / kStep);
  int written = 0;
  for (int pass = 0; written < lines; ++pass) {
    const double y = -45 + 1.5 * (pass % 60);
    const double depth = -1.0 - pass / 60;
    const auto z_at = [&](double x) { return depth + (slopes ? 0.3 * std::sin(0.4 * x + 0.1 * y) - 0.3 : 0); };
    text += fmt::format("G0 X-55 Y{:.3f}\nG1 Z{:.3f} F1800\n", y, z_at(-50));
    for (int k = 0; k <= per_pass && written < lines; ++k, ++written) {
      const double x = -50 + kStep * k;
      text += fmt::format("G1 X{:.4f} Y{:.4f}", x, y + 0.5 * std::sin(0.3 * x));
      if (slopes) text += fmt::format(" Z{:.4f}", z_at(x));
      text += '\n';
    }
    text += "G0 Z5\n";
  }
  return text + "M30\n";
}

machining::Job bench_job() {
  machining::Job job;
  job.machine_name = "lola50";
  job.machine = *machine::load("lola50");
  job.X_MW.p = Vec3(0, -1.3, 0);
  job.cutter = {"5 mm", units::from_mm(5), 3, units::from_deg(30), units::from_mm(20)};
  job.material.ktc = units::from_N_per_mm2(1027.78);
  job.material.krc = units::from_N_per_mm2(182.03);
  job.material.kac = units::from_N_per_mm2(64.5);
  job.material.kte = units::from_N_per_mm(13.65);
  job.material.kre = units::from_N_per_mm(27.95);
  job.material.kae = units::from_N_per_mm(2.21);
  job.stock = *cutting::Stock::block({-55e-3, -50e-3, -20e-3}, {55e-3, 50e-3, 0}, 0.1e-3);
  job.tolerance = 50e-6;
  job.step = 0.5e-3;
  return job;
}

void run(benchmark::State& state, bool correct) {
  const int lines = static_cast<int>(state.range(0));
  const bool slopes = state.range(1) != 0;
  const std::string text = wavy_program(lines, slopes);
  machining::Job job = bench_job();
  // On the slopes a few first cuts hold no tube of 50 um, and what is timed would be the search for a remedy.
  if (slopes) job.tolerance = 300e-6;
  for (auto _ : state) {
    const gcode::Program program = *gcode::parse(text, "bench.ngc");
    const gcode::Interpretation moves = *gcode::interpret(program);
    if (correct) {
      const auto result = machining::correct(job, program, moves);
      if (!result) state.SkipWithError(to_string(result.error()).c_str());
      if (result) {
        state.counters["rewritten"] = result->rewritten_moves;
        state.counters["distance_um"] = units::to_um(result->largest_distance);
        state.counters["rounds"] = result->rounds;
      }
    } else {
      const auto result = machining::predict(job, program, moves);
      if (!result) state.SkipWithError(to_string(result.error()).c_str());
    }
  }
  state.counters["lines_per_second"] =
      benchmark::Counter(lines * double(state.iterations()), benchmark::Counter::kIsRate);
}

void predict_short_lines(benchmark::State& state) {
  run(state, false);
}
BENCHMARK(predict_short_lines)
    ->ArgNames({"lines", "slopes"})
    ->Args({20000, 0})
    ->Args({20000, 1})
    ->Unit(benchmark::kMillisecond);

/// The KUKA KR 210 of examples/bodies follows the program, without bodies or with its capsules and cylinders.
void check_short_lines(benchmark::State& state) {
  const int lines = static_cast<int>(state.range(0));
  const std::string text = wavy_program(lines, true);
  const std::string examples = POLYPOD_SOURCE_DIR "/examples/bodies/";
  const machine::AnyMachine robot = *machine::load(examples + "kuka.toml");
  const Pose X_MW{Mat3::Identity(), Vec3(1.5, 0, 0.8)};
  for (auto _ : state) {
    const gcode::Program program = *gcode::parse(text, "bench.ngc");
    const gcode::Interpretation moves = *gcode::interpret(program);
    machining::CheckOptions options;
    options.limits.joint_speeds = kinematics::speed_limits(robot);
    if (state.range(1) != 0) {
      auto bodies = bodies::read(examples + "bodies.toml", robot);
      if (!bodies) return state.SkipWithError(to_string(bodies.error()).c_str());
      const auto watch = std::make_shared<bodies::Watch>(robot, X_MW, std::move(*bodies));
      options.touches = [watch](const Pose& X_MT, const machine::JointVector& q, bool continues, int tool) {
        const auto pair = watch->to(X_MT, q, continues, tool);
        return pair ? pair->first + " and " + pair->second : std::string();
      };
    }
    const auto result = machining::check(robot, X_MW, program, moves, options);
    if (!result) return state.SkipWithError(to_string(result.error()).c_str());
    state.counters["problems"] = static_cast<double>(result->problems.size());
  }
  state.counters["lines_per_second"] =
      benchmark::Counter(lines * double(state.iterations()), benchmark::Counter::kIsRate);
}
BENCHMARK(check_short_lines)
    ->ArgNames({"lines", "bodies"})
    ->Args({100000, 0})
    ->Args({100000, 1})
    ->Unit(benchmark::kMillisecond);

void correct_short_lines(benchmark::State& state) {
  run(state, true);
}
// Programs of up to some 90 000 points are looked at a second time, with cells and steps of half the size.
BENCHMARK(correct_short_lines)
    ->ArgNames({"lines", "slopes"})
    ->Args({20000, 0})
    ->Args({20000, 1})
    ->Args({100000, 0})
    ->Args({100000, 1})
    ->Unit(benchmark::kMillisecond);

}  // namespace
