// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Workspaces with bounds, and the plain scan beside them with its error.
#include <benchmark/benchmark.h>
#include <fmt/format.h>

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

/// The struts of hexapod-strut without limits of joints, as a machine of legs: the bounds that every machine gets.
machine::AnyMachine as_legs() {
  const auto built_in = std::get<machine::StrutHexapod>(*machine::load("hexapod-strut"));
  std::string text = "family = \"parallel\"\nhome = { z_mm = 75 }\n";
  const auto list = [](const Vec3& p) {
    return fmt::format("[{:.17g}, {:.17g}, {:.17g}]", units::to_mm(p.x()), units::to_mm(p.y()), units::to_mm(p.z()));
  };
  for (std::size_t i = 0; i < 6; ++i) {
    text +=
        fmt::format("[[leg]]\ndrive = \"strut\"\nbase_mm = {}\nplatform_mm = {}\nmin_mm = 50\nmax_mm = 90\n",
                    list(built_in.base_joint[i]), list(built_in.platform_joint[i] - Vec3(0, 0, built_in.tool_length)));
  }
  return *machine::from_text(text, "legs.toml");
}

machine::AnyMachine machine_of(int which) {
  if (which == 4) return as_legs();
  if (which == 1) return *machine::load("hexapod-slider");
  if (which == 2) return *machine::from_text(kGeneral, "general.toml");
  if (which == 3) return *machine::load("lola50");
  return *machine::load("hexapod-strut");
}

/// machine (0 strut, 1 slider, 2 general, 3 arm, 4 the struts as legs), tilt in deg, tolerance in 1e-4, without limits
/// of joints
void bounded(benchmark::State& state) {
  const auto m = machine_of(static_cast<int>(state.range(0)));
  workspace::Options options;
  options.directions.tilt = units::from_deg(static_cast<double>(state.range(1)));
  options.relative_tolerance = 1e-4 * static_cast<double>(state.range(2));
  if (state.range(3) != 0) options.limits &= ~*workspace::limit_bits(m, "joint");
  workspace::Volume v;
  for (auto _ : state) v = *workspace::volume(m, options);
  state.counters["gap_ppm"] = 1e6 * (v.upper - v.lower) / v.volume;
  state.counters["boxes"] = static_cast<double>(v.points);
}
BENCHMARK(bounded)
    ->Args({0, 0, 10, 0})
    ->Args({2, 0, 10, 0})
    ->Args({0, 20, 100, 0})
    ->Args({1, 0, 100, 0})
    ->Args({1, 20, 100, 0})
    ->Args({3, 0, 100, 0})
    ->Args({3, 0, 10, 0})
    ->Args({3, 20, 100, 0})
    ->Args({0, 0, 100, 1})
    ->Args({4, 0, 100, 0})
    ->Args({0, 20, 100, 1})
    ->Args({4, 20, 100, 0})
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
