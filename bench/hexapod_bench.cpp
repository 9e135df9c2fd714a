// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Hexapod kinematics. docs/hexapods.md sets them beside LinuxCNC's genhexkins.
#include <benchmark/benchmark.h>

#include <cmath>

#include "polypod/families/hexapod/modes.hpp"
#include "polypod/families/hexapod/slider_kinematics.hpp"
#include "polypod/families/hexapod/strut_kinematics.hpp"
#include "polypod/machine/any_machine.hpp"

namespace {

using namespace polypod;

Pose pose_at(int k, double tilt) {
  const double azimuth = 0.7 * k;
  return Pose{rotation_of(tilt * Vec3(-std::sin(azimuth), std::cos(azimuth), 0)),
              Vec3(0.005 * std::sin(1.3 * k), 0.005 * std::cos(1.7 * k), 0.075 + 0.003 * std::sin(0.9 * k))};
}

void strut_inverse(benchmark::State& state) {
  const auto m = std::get<machine::StrutHexapod>(*machine::load("hexapod-strut"));
  std::vector<Pose> poses;
  for (int k = 0; k < 64; ++k) poses.push_back(pose_at(k, 0.5));
  double q[6];
  std::size_t k = 0;
  for (auto _ : state) {
    machine::lengths(m, poses[k++ % poses.size()], q);
    benchmark::DoNotOptimize(q);
  }
}
BENCHMARK(strut_inverse);

void slider_inverse(benchmark::State& state) {
  const auto m = std::get<machine::SliderHexapod>(*machine::load("hexapod-slider"));
  std::vector<Pose> poses;
  for (int k = 0; k < 64; ++k) {
    poses.push_back(pose_at(k, 0.3));
    poses.back().p.z() += 0.02;
  }
  machine::SliderRoots roots[6];
  std::size_t k = 0;
  for (auto _ : state) {
    machine::slider_roots(m, poses[k++ % poses.size()], roots);
    benchmark::DoNotOptimize(roots);
  }
}
BENCHMARK(slider_inverse);

/// From a pose 1 mm and 1 deg away, tilted by 30 deg, to rounding.
void strut_forward(benchmark::State& state) {
  const auto m = std::get<machine::StrutHexapod>(*machine::load("hexapod-strut"));
  std::vector<machine::SixLegs> legs;
  std::vector<Pose> seeds;
  for (int k = 0; k < 64; ++k) {
    const Pose X = pose_at(k, 30 * 3.14159265 / 180);
    machine::JointVector q(6);
    machine::lengths(m, X, q.data());
    legs.push_back(machine::six_legs(m, q));
    Pose seed = X;
    seed.p += 0.001 * Vec3(std::sin(k), std::cos(k), 0.5);
    seed.R = rotation_of(0.017 * Vec3(std::cos(2.0 * k), std::sin(3.0 * k), 0.3)) * seed.R;
    seeds.push_back(seed);
  }
  std::size_t k = 0;
  int steps = 0;
  for (auto _ : state) {
    const auto result = machine::newton_on_legs(legs[k % 64], seeds[k % 64]);
    steps = std::max(steps, result.iterations);
    if (!result.converged) state.SkipWithError("not converged");
    benchmark::DoNotOptimize(result.X_MT.p);
    ++k;
  }
  state.counters["steps"] = steps;
}
BENCHMARK(strut_forward);

/// Every assembly mode of general platforms (flat: joints of each platform in a plane), proven.
void all_modes(benchmark::State& state) {
  std::vector<machine::SixLegs> platforms(16);
  std::uint32_t random = 1;
  const auto number = [&] {
    random = 1664525U * random + 1013904223U;
    return static_cast<double>(random >> 8U) / 8388608.0 - 1;
  };
  const double flat = static_cast<double>(state.range(0));
  for (machine::SixLegs& legs : platforms) {
    const Pose X = pose_at(static_cast<int>(random % 64), 0.5);
    for (int i = 0; i < machine::kLegs; ++i) {
      const double ax = number(), ay = number(), az = number(), bx = number(), by = number(), bz = number();
      legs.anchor[i] = 0.08 * Vec3(ax, ay, flat * az);
      legs.end[i] = 0.05 * Vec3(bx, by, flat * bz);
      legs.length[i] = (X * legs.end[i] - legs.anchor[i]).norm();
    }
  }
  std::size_t k = 0;
  int proven = 0;
  for (auto _ : state) {
    const machine::AssemblyModes modes = machine::assembly_modes(platforms[k++ % platforms.size()]);
    proven += modes.complete() ? 1 : 0;
    benchmark::DoNotOptimize(modes.poses.data());
  }
  state.counters["proven"] = benchmark::Counter(proven, benchmark::Counter::kAvgIterations);
}
BENCHMARK(all_modes)->Arg(1)->Arg(0)->ArgName("in_space")->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
