// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common.hpp"
#include "polypod/cell/simulate.hpp"
#include "polypod/core/statistics.hpp"

namespace polypod::cell {

Estimate estimate(const std::vector<double>& values) {
  Estimate out;
  const auto n = static_cast<double>(values.size());
  for (const double v : values) out.mean += v / n;
  if (values.size() < 2) {
    out.half_width = kInfinity;
    return out;
  }
  double squares = 0;
  for (const double v : values) squares += (v - out.mean) * (v - out.mean);
  out.half_width = student_95(n - 1) * std::sqrt(squares / (n - 1) / n);
  return out;
}

Study study(const Cell& cell, const Motions& motions, const RunSettings& settings, int seeds, bool deep) {
  Study out;
  const auto runs = [&](RunSettings with) {
    std::vector<Outcome> outcomes;
    for (int k = 0; k < seeds && out.complete; ++k) {
      with.seed = settings.seed + static_cast<std::uint64_t>(k);
      with.record = with.record && k == 0;
      outcomes.push_back(run(cell, motions, with));
      if (settings.progress && !settings.progress(0)) out.complete = false;
    }
    return outcomes;
  };
  const auto throughputs = [](const std::vector<Outcome>& outcomes) {
    std::vector<double> v;
    for (const Outcome& o : outcomes) v.push_back(o.throughput_per_min());
    return v;
  };
  RunSettings plain = settings;
  out.outcomes = runs(plain);
  const std::vector<double> base = throughputs(out.outcomes);
  out.throughput = estimate(base);
  for (std::size_t m = 0; m < cell.machines.size(); ++m) {
    std::vector<double> v;
    for (const Outcome& o : out.outcomes) v.push_back(o.seconds > 0 ? o.machines[m].busy / o.seconds : 0);
    out.utilisation.push_back(estimate(v));
  }
  if (!deep) return out;
  plain.record = false;
  for (const char* policy : {"first", "nearest", "look-ahead"}) {
    RunSettings with = plain;
    with.policy = policy;
    const std::vector<Outcome> outcomes = runs(with);
    std::vector<double> missed;
    for (const Outcome& o : outcomes) missed.push_back(o.missed);
    out.policies.emplace_back(policy, estimate(throughputs(outcomes)));
    out.missed_by_policy.emplace_back(policy, estimate(missed));
  }
  // What is better by a tenth: each machine, each belt, the camera.
  const auto improvements = [&](const RunSettings& from, double factor, const char* text) {
    std::vector<std::pair<std::string, RunSettings>> list;
    for (std::size_t m = 0; m < cell.machines.size(); ++m) {
      RunSettings with = from;
      with.machine_time.resize(cell.machines.size(), 1);
      with.machine_time[m] /= factor;
      list.emplace_back(fmt::format("{} {}", cell.machines[m].name, text), with);
    }
    for (std::size_t c = 0; c < cell.conveyors.size(); ++c) {
      RunSettings with = from;
      with.belt_speed.resize(cell.conveyors.size(), 1);
      with.belt_speed[c] *= factor;
      list.emplace_back(fmt::format("conveyor {} {}", cell.conveyors[c].name, text), with);
    }
    return list;
  };
  const auto gains = [&](const RunSettings& from, const std::vector<double>& before) {
    std::vector<Gain> list;
    for (const auto& [what, with] : improvements(from, 1.1, "10 % faster")) {
      std::vector<double> after = throughputs(runs(with));
      for (std::size_t k = 0; k < after.size() && k < before.size(); ++k) after[k] -= before[k];
      list.push_back({what, estimate(after)});
    }
    std::stable_sort(list.begin(), list.end(),
                     [](const Gain& a, const Gain& b) { return a.change.mean > b.change.mean; });
    return list;
  };
  out.gains = gains(plain, base);
  // The same where what gains most is twice as fast.
  if (!out.gains.empty() && out.gains.front().change.mean > 0) {
    const auto twice = improvements(plain, 2.0, "10 % faster");
    for (const auto& [what, with] : twice) {
      if (what != out.gains.front().what) continue;
      out.next_gains = gains(with, throughputs(runs(with)));
      std::erase_if(out.next_gains, [&](const Gain& g) { return g.what == out.gains.front().what; });
    }
  }
  return out;
}

}  // namespace polypod::cell
