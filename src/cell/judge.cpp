// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cell/judge.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "common.hpp"
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
    if (!o.full.empty()) {
      out.problems.push_back(
          {"full", fmt::format("since {:.1f} s {} is full, and no task takes anything from it (seed {}): simulate a "
                               "shorter time, or give it more places",
                               *o.stands_since, o.full, question.settings.seed + k)});
      break;
    }
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

/// Distance of a point from a box as seen from above.
double in_plan(const Vec3& p, const Body& b) {
  const double c = std::cos(b.turn), n = std::sin(b.turn);
  const Vec3 d = p - b.middle;
  const double x = std::abs(c * d.x() + n * d.y()) - b.size.x() / 2,
               y = std::abs(-n * d.x() + c * d.y()) - b.size.y() / 2;
  return std::hypot(std::max(x, 0.0), std::max(y, 0.0));
}

/// Where items land that go from belt to belt, and whether belts with a sensor stop in time.
void judge_belts(CellResult& out) {
  constexpr double kSame = 1e-3;  // m
  const auto mm = [](double v) { return units::to_mm(v); };
  for (const Conveyor& c : out.cell.conveyors) {
    for (const Conveyor& o : out.cell.conveyors) {
      if (o.name != c.onto) continue;
      const double fall = c.at.z() - o.at.z(), flight = c.flight(fall);
      if (c.chute.empty()) {
        if (std::abs(c.drop - flight) > c.drop_spread + kSame) {
          out.problems.push_back(
              {"drop", fmt::format("items fall {:.0f} mm from {} at {:g} mm/s and land {:.0f} mm beyond its end; "
                                   "drop_mm = {:g} +- {:g} is not that: move a belt, or name a chute that leads them",
                                   mm(fall), c.name, mm(c.speed), mm(flight), mm(c.drop), mm(c.drop_spread))});
        }
        const Vec3 d = c.point(c.length + flight, 0) - o.at;
        const double cs = std::cos(o.heading), sn = std::sin(o.heading);
        const double along = cs * d.x() + sn * d.y(), across = -sn * d.x() + cs * d.y();
        if (along < 0 || along > o.length || std::abs(across) > o.width / 2)
          out.problems.push_back(
              {"drop", fmt::format("items that fall from {} land {:.0f} mm beyond its end, beside the "
                                   "belt of {}",
                                   c.name, mm(flight), o.name)});
        continue;
      }
      const Body& chute = *std::find_if(out.cell.bodies.begin(), out.cell.bodies.end(),
                                        [&](const Body& b) { return b.name == c.chute; });
      const double item = out.cell.items.empty() ? 0 : out.cell.items[0].diameter;
      double gap = std::max(0.0, in_plan(c.point(c.length, 0), chute) - item / 2);
      for (const double drop : {c.drop - c.drop_spread, c.drop + c.drop_spread})
        gap = std::max(gap, in_plan(c.point(c.length + drop, 0), chute) - item / 2 - 2 * c.drop_spread);
      if (gap > kSame)
        out.problems.push_back({"drop", fmt::format("the chute {} leaves a gap of {:.0f} mm between the end of {} and "
                                                    "where items land on {}",
                                                    chute.name, mm(gap), c.name, o.name)});
    }
    if (c.sensor < 0 || !(c.acceleration > 0)) continue;
    const double way = c.speed * c.speed / (2 * c.acceleration);
    double space = c.length - c.sensor;
    for (const Task& t : out.cell.tasks)
      if (t.from_conveyor >= 0 && out.cell.conveyors[static_cast<std::size_t>(t.from_conveyor)].name == c.name)
        space = std::min(space, t.window_high - c.sensor);
    if (way > space + 1e-9)
      out.problems.push_back(
          {"belt", fmt::format("{} needs {:.1f} mm to stop, and {:.1f} mm lie between its sensor and "
                               "the end of the window: move the sensor, or run it slower",
                               c.name, mm(way), mm(std::max(space, 0.0)))});
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
    const bool out_of_reach =
        r.motions.out_of_reach > 0 || std::any_of(r.motions.problems.begin(), r.motions.problems.end(),
                                                  [](const Problem& p) { return p.kind == "reach"; });
    out.emplace_back(out_of_reach ? "the cycle: something is out of reach" : "the cycle: the rest has problems");
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
    if (g.measured)
      out.push_back(fmt::format("guard {}: it is not far enough by itself; a person must judge its measure", g.name));
  out.insert(out.end(), r.safety.not_judged.begin(), r.safety.not_judged.end());
  for (const Conveyor& c : r.cell.conveyors)
    if (!c.chute.empty()) out.push_back(fmt::format("whether items slide down the chute {} of {}", c.chute, c.name));
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
  for (const Conveyor& c : cell.conveyors) {
    std::string text = fmt::format("{} starts and stops at once in the simulation", c.name);
    double space = kInfinity;
    for (const Task& t : cell.tasks)
      if (c.sensor >= 0 && t.from_conveyor >= 0 &&
          cell.conveyors[static_cast<std::size_t>(t.from_conveyor)].name == c.name)
        space = std::min(space, t.window_high - c.sensor);
    if (c.acceleration > 0)
      text += fmt::format("; its {:g} mm/s2 are judged at its sensor alone", units::to_mm(c.acceleration));
    else if (std::isfinite(space) && space > 0)
      text += fmt::format("; to stop within the {:g} mm from its sensor to the end of the window it needs {:.0f} mm/s2",
                          units::to_mm(space), units::to_mm(c.speed * c.speed / (2 * space)));
    out.push_back(text);
  }
  for (const auto& [what, why] : cell.assumptions) out.push_back(fmt::format("{}: {}", what, why));
  return out;
}

}  // namespace

CellQuestion question_of(const Cell& cell) {
  CellQuestion out;
  out.settings.seconds = units::to_per_min(cell.minutes);
  out.settings.seed = static_cast<std::uint64_t>(cell.seed);
  out.settings.policy = cell.policy;
  return out;
}

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
  judge_belts(out);
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
  out.assumed.insert(out.assumed.end(), out.motions.assumed.begin(), out.motions.assumed.end());
  out.not_judged = not_judged(out);
  return out;
}

}  // namespace polypod::cell
