// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Any bytes as a cell file: refused with an error, or a cell whose text can be kept and read back, whose sequence can
// be written, and whose cycle comes to an end with counts that add up. Machines stand still where they are: what they
// reach is asked elsewhere, and costs a thousand times more.
#include <cmath>
#include <cstdint>
#include <string_view>

#include "polypod/cell/layout.hpp"
#include "polypod/cell/planning.hpp"
#include "polypod/cell/rewrite.hpp"
#include "polypod/cell/safety.hpp"
#include "polypod/cell/sequence.hpp"
#include "polypod/cell/simulate.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "require.hpp"

namespace {

using namespace polypod;
using fuzz::require;

/// Every place in reach, every way half a second.
cell::Motions still(const cell::Cell& c) {
  cell::Motions out;
  for (const cell::Machine& m : c.machines) {
    const machine::JointVector q = machine::JointVector::Zero(kinematics::joint_count(m.model));
    out.home.push_back(q);
    std::vector<std::vector<cell::Stand>> spots;
    for (const cell::Spot& s : c.spots) {
      cell::Stand stand;
      stand.ok = true;
      stand.above = stand.joints = q;
      stand.straight = 0.5;
      spots.emplace_back(s.slots.size(), stand);
    }
    out.stands.push_back(std::move(spots));
  }
  for (const cell::Task& t : c.tasks) {
    cell::PickTable table;
    if (t.from_conveyor >= 0) {
      table.low = t.window_low;
      table.high = t.window_high;
      table.columns = table.rows = 1;
      const std::size_t slots = c.spots[static_cast<std::size_t>(t.to)].slots.size();
      table.times.assign(slots + 1, {0.5});
      table.home_times.assign(slots + 1, 0.5);
    }
    out.picks.push_back(std::move(table));
  }
  return out;
}

void judge(const cell::Cell& c) {
  const auto [low, high] = cell::extent(c);
  require(low.allFinite() && high.allFinite() && (low.array() <= high.array()).all(), "a cell has an extent");
  for (const cell::Solid& s : cell::solids(c))
    require(s.middle.allFinite() && (s.size.array() >= 0).all(), "bodies are finite");
  for (const cell::StandingContainer& s : cell::standing_containers(c))
    require(s.bottom.allFinite(), "containers stand somewhere");
  require(std::isfinite(c.cost.total()) && c.cost.total() >= 0, "costs add up");
  require(!cell::sequence(c).empty(), "a cell has a sequence");
  const std::string text = cell::structured_text(c);
  require(text.ends_with("END_PROGRAM\n"), "a program ends");
  require(cell::plcopen_xml(c).ends_with("</project>\n"), "a project ends");
  constexpr std::size_t kFewGuards = 3, kFewStations = 5;
  if (c.guards.size() <= kFewGuards) {
    const cell::Safety s = cell::safety(c, {{(low + high) / 2, 0.1, "machine", (low + high) / 2 + Vec3(0, 0, 0.1)}});
    require(std::isnan(s.guard_distance) || (std::isfinite(s.guard_distance) && s.guard_distance >= 0),
            "a guard has a distance, or none of the standard");
  }
  if (c.stations.size() <= kFewStations)
    for (const cell::Plan& p : cell::planning(c, {}).plans) require(std::isfinite(p.score), "a plan has a score");
}

void run(const cell::Cell& c) {
  cell::RunSettings settings;
  settings.seconds = 3;
  settings.policy = c.policy;
  settings.seed = static_cast<std::uint64_t>(c.seed);
  const cell::Motions motions = still(c);
  const cell::Outcome o = cell::run(c, motions, settings);
  require(o.seconds >= 0 && o.seconds <= settings.seconds, "time goes on to its end");
  require(o.placed >= 0 && o.missed >= 0 && o.remaining >= 0, "counts are none below 0");
  for (const cell::MachineUse& m : o.machines)
    require(m.busy >= 0 && m.busy <= o.seconds + 1e-6, "a machine works now");
  const cell::Outcome again = cell::run(c, motions, settings);
  require(again.placed == o.placed && again.missed == o.missed && again.calendar == o.calendar,
          "the same seed gives the same run");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  for (const auto& [key, counted, value] : cell::numbers_of(text))
    require(!key.empty() && !std::isnan(value), "a key has a number");
  const auto c = cell::from_text(text, "fuzz.toml");
  if (!c) return fuzz::require_error(c.error()), 0;
  const auto kept = cell::self_contained(text, "fuzz.toml");
  require(kept.has_value(), "what is a cell can be kept");
  const auto again = cell::from_text(*kept, "kept.toml");
  if (!again) std::fprintf(stderr, "%s\n%s\n", to_string(again.error()).c_str(), kept->c_str());
  require(again.has_value(), "a kept cell reads back");
  const auto twice = cell::self_contained(*kept, "kept.toml");
  require(twice.has_value() && *twice == *kept, "a kept cell is kept the same");
  judge(*c);
  run(*c);
  return 0;
}
