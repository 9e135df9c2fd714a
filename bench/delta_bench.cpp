// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Closed kinematics of deltas, one pose at a time over many poses, and their workspaces.
#include <benchmark/benchmark.h>

#include <random>

#include "polypod/families/delta/kinematics.hpp"
#include "polypod/machine/any_machine.hpp"
#include "polypod/motion/cycles.hpp"
#include "polypod/workspace/volume.hpp"

namespace {

using namespace polypod;

constexpr std::size_t kPoses = 1024;

std::vector<Vec3> poses() {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> across(-0.2, 0.2), down(0.42, 0.6);
  std::vector<Vec3> out(kPoses);
  for (Vec3& X : out) X = {across(random), across(random), down(random)};
  return out;
}

void inverse_arms(benchmark::State& state) {
  const auto m = std::get<machine::RotaryDelta>(*machine::load("delta-brno"));
  const auto X = poses();
  std::size_t k = 0;
  double q[3];
  for (auto _ : state) {
    benchmark::DoNotOptimize(drive_positions(m, X[k++ % kPoses], q));
    benchmark::DoNotOptimize(q);
  }
}
BENCHMARK(inverse_arms);

void forward_arms(benchmark::State& state) {
  const auto m = std::get<machine::RotaryDelta>(*machine::load("delta-brno"));
  const auto X = poses();
  std::vector<machine::JointVector> q(kPoses, machine::JointVector(3));
  for (std::size_t k = 0; k < kPoses; ++k) drive_positions(m, X[k], q[k].data());
  std::size_t k = 0;
  for (auto _ : state) benchmark::DoNotOptimize(both_poses(m, q[k++ % kPoses]));
}
BENCHMARK(forward_arms);

machine::LinearDelta rails() {
  return std::get<machine::LinearDelta>(*machine::load("delta-linear"));
}
std::vector<Vec3> poses_on_rails(const machine::LinearDelta& m) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> part(-0.1, 0.1);
  std::vector<Vec3> out(kPoses);
  for (Vec3& X : out) X = m.home + Vec3(part(random), part(random), part(random));
  return out;
}

void inverse_rails(benchmark::State& state) {
  const auto m = rails();
  const auto X = poses_on_rails(m);
  std::size_t k = 0;
  double q[3];
  for (auto _ : state) {
    benchmark::DoNotOptimize(drive_positions(m, X[k++ % kPoses], q));
    benchmark::DoNotOptimize(q);
  }
}
BENCHMARK(inverse_rails);

void forward_rails(benchmark::State& state) {
  const auto m = rails();
  const auto X = poses_on_rails(m);
  std::vector<machine::JointVector> q(kPoses, machine::JointVector(3));
  for (std::size_t k = 0; k < kPoses; ++k) drive_positions(m, X[k], q[k].data());
  std::size_t k = 0;
  for (auto _ : state) benchmark::DoNotOptimize(both_poses(m, q[k++ % kPoses]));
}
BENCHMARK(forward_rails);

/// 0: delta-brno, 1: delta-linear, 2: delta-picker with collisions; to 0.5 %.
void bounded(benchmark::State& state) {
  const char* names[] = {"delta-brno", "delta-linear", "delta-picker"};
  const auto m = *machine::load(names[state.range(0)]);
  workspace::Options options;
  options.relative_tolerance = 0.005;
  options.interference = state.range(0) == 2;
  workspace::Volume v;
  for (auto _ : state) v = *workspace::volume(m, options);
  state.counters["gap_ppm"] = 1e6 * (v.upper - v.lower) / v.volume;
}
BENCHMARK(bounded)->DenseRange(0, 2)->Unit(benchmark::kMillisecond)->UseRealTime();

/// The usual cycle of 25 / 305 / 25 mm.
void cycle(benchmark::State& state) {
  const auto m = *machine::load("delta-brno");
  const motion::Cycle c{Vec3(-0.1525, 0, 0.55), Vec3(0.1525, 0, 0.55), 0.025, 0.015};
  motion::Plan plan;
  for (auto _ : state) plan = *motion::plan(m, c, {});
  state.counters["cycle_ms"] = 1e3 * plan.time;
}
BENCHMARK(cycle)->Unit(benchmark::kMicrosecond);

}  // namespace
