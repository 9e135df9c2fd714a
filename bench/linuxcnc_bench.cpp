// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Exported kinematics modules as LinuxCNC calls them every millisecond: the inverse of a pose a little on, and the
// forward of its joints from the pose before. The aim: below 1 us (inverse) and 3 us (forward) for a hexapod.
// genhexkins is the peer.
#include <benchmark/benchmark.h>

#include <fstream>
#include <map>
#include <memory>

#include "control/module_host.hpp"
#include "polypod/control/linuxcnc.hpp"
#include "polypod/control/settings.hpp"

namespace polypod {
namespace {

struct Machine {
  test::Folder folder;
  control::LinuxcncConfiguration c;
  std::unique_ptr<test::ModuleHost> host;
  std::vector<double> home_joints, home;
};

Machine& machine_of(const std::string& name) {
  static std::map<std::string, std::unique_ptr<Machine>> all;
  std::unique_ptr<Machine>& out = all[name];
  if (out) return *out;
  out = std::make_unique<Machine>();
  control::LinuxcncOptions options;
  options.stands = 100;
  out->c = *control::linuxcnc_configuration(*machine::load(name), options);
  const auto file = out->folder.path() / (out->c.module.name + ".c");
  std::ofstream(file) << out->c.module.source;
  out->host = std::make_unique<test::ModuleHost>(test::compiled(file).string());
  for (const auto& joint : out->c.joints) out->home_joints.push_back(joint.home);
  out->home.assign(6, 0.0);
  for (const auto& axis : out->c.axes) out->home[std::string_view("XYZABC").find(axis.letter)] = axis.home;
  return *out;
}

/// 0.1 mm and 0.01 deg a cycle round home, as at 100 mm/s.
std::vector<double> on(const Machine& m, int k) {
  std::vector<double> out = m.home;
  for (const auto& axis : m.c.axes) {
    const double share = ((k * (axis.letter - 'A' + 3)) % 41 - 20) / 20.0;
    out[std::string_view("XYZABC").find(axis.letter)] += share * (axis.turns ? 0.2 : 2);
  }
  return out;
}

void inverse(benchmark::State& state, const std::string& name) {
  Machine& m = machine_of(name);
  std::vector<std::vector<double>> poses;
  for (int k = 0; k < 64; ++k) poses.push_back(on(m, k));
  std::vector<double> q = m.home_joints;
  std::size_t k = 0;
  for (auto _ : state) {
    if (m.host->inverse(poses[k++ % poses.size()], q) != 0) state.SkipWithError("no joints");
    benchmark::DoNotOptimize(q.data());
  }
}
void forward(benchmark::State& state, const std::string& name) {
  Machine& m = machine_of(name);
  std::vector<std::vector<double>> joints, seeds;
  for (int k = 0; k < 64; ++k) {
    std::vector<double> q = m.home_joints, pose = on(m, k);
    m.host->inverse(pose, q);
    joints.push_back(q);
    for (const auto& axis : m.c.axes) pose[std::string_view("XYZABC").find(axis.letter)] += axis.turns ? 0.01 : 0.1;
    seeds.push_back(pose);
  }
  std::vector<double> pose(6);
  std::size_t k = 0;
  for (auto _ : state) {
    pose = seeds[k % 64];
    if (m.host->forward(joints[k++ % 64], pose) != 0) state.SkipWithError("no pose");
    benchmark::DoNotOptimize(pose.data());
  }
}
void peer(benchmark::State& state, bool is_forward) {
  test::ModuleHost genuine("genhexkins");
  const auto settings = *control::settings_for(*machine::load("hexapod-strut"), control::Controller::linuxcnc);
  for (const auto& s : settings.settings)
    if (s.section == "HAL") genuine.set(s.key.substr(s.key.find('.') + 1), s.value);
  std::vector<double> pose{1, 2, 76, 1, -1, 2}, q(6);
  genuine.inverse(pose, q);
  const std::vector<double> seed{1.1, 2.1, 76.1, 1.01, -0.99, 2.01};
  std::vector<double> at = seed;
  genuine.forward(q, at);
  for (auto _ : state) {
    at = seed;
    benchmark::DoNotOptimize(is_forward ? genuine.forward(q, at) : genuine.inverse(pose, q));
  }
}

const bool kRegistered = [] {
  for (const char* name :
       {"hexapod-strut", "hexapod-slider", "delta-brno", "pentapod", "tricept", "lola50", "ur10e", "tricept-wrist"}) {
    benchmark::RegisterBenchmark((std::string("inverse/") + name).c_str(),
                                 [name](benchmark::State& state) { inverse(state, name); });
    benchmark::RegisterBenchmark((std::string("forward/") + name).c_str(),
                                 [name](benchmark::State& state) { forward(state, name); });
  }
  benchmark::RegisterBenchmark("inverse/genhexkins", [](benchmark::State& state) { peer(state, false); });
  benchmark::RegisterBenchmark("forward/genhexkins", [](benchmark::State& state) { peer(state, true); });
  return true;
}();

}  // namespace
}  // namespace polypod
