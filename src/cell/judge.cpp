// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cell/judge.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "polypod/core/units.hpp"

namespace polypod::cell {
namespace {

/// What went wrong in the runs of the cycle.
void judge_cycle(CellResult& out, const CellQuestion& question) {
  int missed = 0, unseen = 0;
  for (const Outcome& o : out.study.outcomes) {
    missed += o.missed;
    unseen += o.unseen;
  }
  const std::string in_runs =
      out.study.outcomes.size() == 1 ? "" : fmt::format(" in {} runs", out.study.outcomes.size());
  for (const Outcome& o : out.study.outcomes) {
    if (o.crowded.empty()) continue;
    out.problems.push_back(
        {"crowded", fmt::format("more than 5000 items gather on conveyor {}; the simulation ended after {:.1f} s",
                                o.crowded, o.seconds)});
    break;
  }
  if (missed > 0)
    out.problems.push_back(
        {"missed", fmt::format("{} items fall off the end of a belt{}: the cell does not keep up", missed, in_runs)});
  if (unseen > 0)
    out.problems.push_back({"unseen", fmt::format("{} items lie wholly in no picture of a camera{}", unseen, in_runs)});
  for (std::size_t k = 0; k < out.study.outcomes.size(); ++k) {
    const Outcome& o = out.study.outcomes[k];
    if (!o.stands_since) continue;
    out.problems.push_back({"deadlock", fmt::format("since {:.1f} s nothing can go on (seed {}): {}", *o.stands_since,
                                                    question.settings.seed + k, o.standstill)});
    break;
  }
  for (std::size_t k = 0; k < out.cell.sources.size() && out.simulated(); ++k) {
    int lost = 0;
    double held = 0;
    for (const Outcome& o : out.study.outcomes) {
      lost += o.lost[k];
      held += o.held[k];
    }
    if (lost == 0) continue;
    const Source& source = out.cell.sources[k];
    out.problems.push_back(
        {"source",
         fmt::format(
             "source {} waits {:.0f} s because conveyor {} stands, and {} of its items do not come in time{}: the "
             "cell does not keep up",
             source.name, held, out.cell.conveyors[static_cast<std::size_t>(source.conveyor)].name, lost, in_runs)});
  }
  if (out.simulated()) {
    const Outcome& o = out.outcome();
    if (out.cell.commands.empty())
      out.problems.push_back({"command", "nobody presses START: add a [[command]]"});
    else if (!(o.working > 0))
      out.problems.push_back({"command", fmt::format("nobody presses START within the simulated {:.0f} s", o.seconds)});
    else if (!o.stands_since && std::all_of(o.done.begin(), o.done.end(), [](int n) { return n == 0; }))
      out.problems.push_back(
          {"nothing done", fmt::format("no task was done within {:.0f} s: the cycle is not judged; simulate longer "
                                       "(--minutes), or see why nothing comes",
                                       o.seconds)});
  }
}

/// How often something goes from station to station, an hour of the first run.
std::vector<Flow> flows_of(const CellResult& out) {
  std::vector<Flow> flows;
  if (out.simulated()) {
    const Outcome& o = out.outcome();
    const auto index = [&](const std::string& name) {
      for (std::size_t k = 0; k < out.cell.stations.size(); ++k)
        if (out.cell.stations[k].name == name) return static_cast<int>(k);
      return -1;
    };
    for (const Traffic& t : o.traffic) {
      const int from = index(t.from), to = index(t.to);
      if (from >= 0 && to >= 0 && from != to && o.seconds > 0)
        flows.push_back({from, to, units::to_per_min(units::to_per_min(t.count / o.seconds))});
    }
  }
  return flows;
}

/// What of this cell no part of the answer looks at.
std::vector<std::string> not_judged(const CellResult& r) {
  std::vector<std::string> out;
  if (!r.simulated()) {
    out.emplace_back("the cycle: something is out of reach");
  } else {
    for (std::size_t t = 0; t < r.cell.tasks.size(); ++t) {
      const bool never = std::all_of(r.study.outcomes.begin(), r.study.outcomes.end(),
                                     [&](const Outcome& o) { return o.done[t] == 0; });
      if (never)
        out.push_back(
            fmt::format("task {} in the cycle: it was not done within the simulated time", r.cell.tasks[t].name));
    }
  }
  for (const Machine& m : r.cell.machines)
    if (!(m.payload > 0)) out.push_back(fmt::format("the load of {}: it has no payload_kg", m.name));
  for (const GuardFigure& g : r.safety.guards)
    if (!g.enough && !g.note.empty() && r.safety.problems.empty())
      out.push_back(fmt::format("guard {}: it is not far enough by itself; a person must judge its measure", g.name));
  if (!r.cell.open_sides.empty() && !way_in(r.cell, r.layout.swept).empty())
    out.push_back(fmt::format("what protects where no guard stands: {}", r.cell.open_sides));
  if (!r.layout.complete)
    out.emplace_back(
        "collisions in all positions: some were left out, because there are too many, or because no way was found");
  for (std::size_t m = 0; m < r.cell.machines.size(); ++m) {
    const Machine& machine = r.cell.machines[m];
    const std::vector<BaseBody> base = bases(machine, r.motions.home[m]);
    std::string modelled = "links of one diameter";
    for (const BaseBody& b : base)
      if (b.disc) modelled += fmt::format(" and its base, a disc of {:.0f} mm", units::to_mm(2 * b.radius));
    out.push_back(fmt::format("collisions of {} with more than {}: {}drives, gears, cables and hoses are no bodies",
                              machine.name, modelled, base.empty() ? "its base, " : ""));
  }
  out.emplace_back("collisions between the positions, and of a machine with itself and what it carries");
  return out;
}

/// Defaults that the answer rests on, and the assumptions of the file.
std::vector<std::string> assumed(const Cell& cell) {
  std::vector<std::string> out;
  for (const Container& c : cell.containers) {
    if (!c.grip_given)
      out.push_back(fmt::format("{}: grip_mm = {:g}, half of its height, by default", c.name, units::to_mm(c.grip)));
  }
  for (std::size_t m = 0; m < cell.machines.size(); ++m) {
    const Machine& machine = cell.machines[m];
    bool cycles = false, moves = false;  // by planned cycles of a delta, by its joints
    for (const Task& t : cell.tasks) {
      if (t.machine != static_cast<int>(m)) continue;
      const bool cycle = t.from_conveyor >= 0 && has_cycles(machine);
      cycles |= cycle;
      moves |= !cycle;
    }
    std::vector<std::string> keys;
    for (const auto& [key, value] : machine.defaults) {
      const auto begins = [&k = key](const char* word) { return k.starts_with(word); };
      const bool counts = begins("body_") || begins("grip_s") || begins("release_s") ||
                          (cycles && (begins("tool_") || begins("drive_") || begins("lift") || begins("blend"))) ||
                          (moves && (begins("joint_") || begins("straight_")));
      if (counts) keys.push_back(fmt::format("{} = {:.4g}", key, value));
    }
    if (!keys.empty()) out.push_back(fmt::format("{}: {}, by default", machine.name, fmt::join(keys, ", ")));
  }
  for (const auto& [what, why] : cell.assumptions) out.push_back(fmt::format("{}: {}", what, why));
  return out;
}

}  // namespace

CellResult judge_cell(Cell given, const CellQuestion& question) {
  CellResult out;
  out.cell = std::move(given);
  out.policy = question.settings.policy;
  out.motions = motions(out.cell);
  out.layout = layout(out.cell, out.motions);
  out.safety = safety(out.cell, out.layout.swept, out.layout.gaps);
  out.problems = out.motions.problems;
  out.problems.insert(out.problems.end(), out.layout.problems.begin(), out.layout.problems.end());
  out.problems.insert(out.problems.end(), out.safety.problems.begin(), out.safety.problems.end());
  const bool reached = std::none_of(out.motions.problems.begin(), out.motions.problems.end(),
                                    [](const Problem& p) { return p.kind == "reach"; });
  std::vector<Flow> flows;
  if (reached && (!question.only_sound || out.problems.empty())) {
    out.study = study(out.cell, out.motions, question.settings, question.seeds, question.compare);
    judge_cycle(out, question);
    flows = flows_of(out);
  }
  if (out.cell.cost.budget > 0 && out.cell.cost.reserve() < 0) {
    out.problems.push_back(
        {"budget", fmt::format("the parts cost {:.2f} {}, {:.2f} more than the budget", out.cell.cost.total(),
                               out.cell.cost.currency, -out.cell.cost.reserve())});
  }
  if (question.plan) out.planning = planning(out.cell, flows);
  out.assumed = assumed(out.cell);
  out.not_judged = not_judged(out);
  return out;
}

}  // namespace polypod::cell
