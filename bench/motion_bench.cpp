// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Forces of the drives at one instant of a motion, and programs of short lines planned within jerk limits.
#include <benchmark/benchmark.h>

#include <cmath>

#include "polypod/kinematics/any_machine.hpp"
#include "polypod/motion/dynamics.hpp"
#include "polypod/motion/machine_motion.hpp"

namespace {

using namespace polypod;

/// Masses of every part that the machine has.
motion::Dynamics masses_of(const machine::AnyMachine& m) {
  motion::Dynamics d;
  d.platform = motion::Body{3, Vec3(0.004, -0.002, -0.03), 0.01 * Mat3::Identity()};
  d.payload = motion::Body{1, Vec3(0, 0, 0.02), Mat3::Zero()};
  if (std::holds_alternative<machine::StrutHexapod>(m)) {
    d.strut_fixed = 2, d.strut_fixed_center = 0.03, d.strut_fixed_inertia = 0.002;
    d.strut_moving = 1, d.strut_moving_center = 0.02, d.strut_moving_inertia = 0.001;
  }
  if (std::holds_alternative<machine::RotaryDelta>(m)) {
    d.rod = 0.2;
    d.arm = 0.4, d.arm_center = 0.08, d.arm_inertia = 0.005;
  }
  if (const auto* arm = std::get_if<machine::SerialArm>(&m)) {
    d.links.assign(arm->dh.size(), motion::Body{40, Vec3(0.1, 0.02, 0), Vec3(0.5, 1, 1.2).asDiagonal()});
  }
  return d;
}

/// The tool goes along a parabola.
struct Instant {
  machine::AnyMachine machine;
  machine::JointVector joints;
  Pose X;
  motion::PoseSeries path;
};
Instant instant(const char* name, const Vec3& tip) {
  Instant out;
  out.machine = *machine::load(name);
  const Pose target{Mat3::Identity(), tip};
  out.joints = kinematics::inverse(out.machine, target).solutions.at(0).joints;
  out.X = kinematics::settled(out.machine, target, out.joints);
  out.path = out.X.cast<Series>();
  for (int k = 0; k < 3; ++k) out.path.p[k] = Series(out.X.p[k], 0.1 * (k + 1), 0.5 - 0.2 * k, 0.1);
  return out;
}

/// Speed, acceleration and jerk of the drives.
void drives(benchmark::State& state, const char* name, const Vec3& tip) {
  const Instant at = instant(name, tip);
  for (auto _ : state) benchmark::DoNotOptimize(motion::joint_series(at.machine, at.path, at.X, at.joints));
}
BENCHMARK_CAPTURE(drives, hexapod, "hexapod-strut", Vec3(0.002, 0.001, 0.075));
BENCHMARK_CAPTURE(drives, delta, "delta-brno", Vec3(0.05, 0.02, 0.5));
BENCHMARK_CAPTURE(drives, arm, "lola50", Vec3(0.1, -1.3, 0));

/// Their forces, once it is known how they move.
void forces(benchmark::State& state, const char* name, const Vec3& tip) {
  const Instant at = instant(name, tip);
  const motion::Dynamics d = masses_of(at.machine);
  const motion::JointSeries q = motion::joint_series(at.machine, at.path, at.X, at.joints);
  for (auto _ : state) benchmark::DoNotOptimize(motion::drive_forces(at.machine, d, q));
}
BENCHMARK_CAPTURE(forces, hexapod, "hexapod-strut", Vec3(0.002, 0.001, 0.075));
BENCHMARK_CAPTURE(forces, delta, "delta-brno", Vec3(0.05, 0.02, 0.5));
BENCHMARK_CAPTURE(forces, arm, "lola50", Vec3(0.1, -1.3, 0));

/// Lines on a wavy way, each from rest to rest: lines a second. Those of 0.25 mm are passed by S profiles.
void planned(benchmark::State& state, const char* name, const Vec3& start, int count, double length) {
  const machine::AnyMachine m = *machine::load(name);
  const auto at = [&](int k) {
    return motion::TargetPose{start + length * Vec3(k, 4 * std::sin(0.3 * k), 0), Vec3::Zero()};
  };
  std::vector<motion::Stretch> lines;
  for (int k = 0; k < count; ++k) lines.push_back(*motion::straight(at(k), at(k + 1)));
  const motion::PosePath path = *motion::pose_path_of(lines);
  motion::MoveOptions options;
  options.law = motion::Law::fastest;
  options.limits.tool_speed = 0.5;
  options.limits.tool_acceleration = 5;
  options.limits.tool_jerk = 100;
  const int drives = kinematics::joint_count(m);
  options.limits.drive_speed = machine::JointVector::Constant(drives, 1);
  options.limits.drive_acceleration = machine::JointVector::Constant(drives, 4);
  options.limits.drive_jerk = machine::JointVector::Constant(drives, 80);
  double time = 0;
  for (auto _ : state) {
    const auto moved = motion::move(m, path, options);
    if (!moved) state.SkipWithError(to_string(moved.error()).c_str());
    time = moved ? moved->time : 0;
  }
  state.counters["time_s"] = time;
  state.counters["lines_per_second"] =
      benchmark::Counter(count * double(state.iterations()), benchmark::Counter::kIsRate);
}
BENCHMARK_CAPTURE(planned, delta, "delta-linear", Vec3(0, 0, 0.45), 50, 0.25e-3)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(planned, arm, "lola50", Vec3(0, -1.3, 0), 50, 0.25e-3)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(planned, delta_long, "delta-brno", Vec3(-0.1, 0, 0.5), 5, 40e-3)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(planned, arm_long, "lola50", Vec3(-0.1, -1.3, 0), 5, 50e-3)->Unit(benchmark::kMillisecond);

}  // namespace
