// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cell/sequence.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "plc_program.hpp"

namespace polypod::cell {
namespace {

const Spot& spot_of(const Cell& cell, int index) {
  return cell.spots[static_cast<std::size_t>(index)];
}

std::string source_name(const Cell& cell, const Task& task) {
  return task.from_conveyor >= 0 ? cell.conveyors[static_cast<std::size_t>(task.from_conveyor)].name
                                 : spot_of(cell, task.from).name;
}

}  // namespace

std::string condition_of(const Cell& cell, const Task& task) {
  const Spot& to = spot_of(cell, task.to);
  std::string out;
  if (task.on_serve) out = "SERVE was pressed; ";
  if (task.from_conveyor >= 0)
    return out + fmt::format("an item on {} is known and can be met in the window; a container with room stands in {}",
                             source_name(cell, task), to.name);
  const char* which = task.which == Task::Which::full ? "full " : task.which == Task::Which::empty ? "empty " : "";
  out += fmt::format("a {}container stands in {}", which, source_name(cell, task));
  if (task.to != task.from) out += fmt::format("; a place in {} is free", to.name);
  return out;
}

namespace {

std::string action_of(const Cell& cell, const Task& task) {
  const std::string machine = cell.machines[static_cast<std::size_t>(task.machine)].name;
  std::string out = fmt::format("{}: {} from {}", machine, task.name, source_name(cell, task));
  if (task.via >= 0) out += fmt::format(", empty it at {}", spot_of(cell, task.via).name);
  out += task.from_conveyor < 0 && task.to == task.from ? ", put it back"
                                                        : fmt::format(" to {}", spot_of(cell, task.to).name);
  std::set<std::string> zones;
  for (const int s : {task.from, task.via, task.to})
    if (s >= 0 && !spot_of(cell, s).zone.empty()) zones.insert(spot_of(cell, s).zone);
  for (const std::string& zone : zones) out += fmt::format("; only with the zone \"{}\"", zone);
  return out;
}

bool ends(const Cell& cell) {
  return std::any_of(cell.tasks.begin(), cell.tasks.end(), [](const Task& t) { return t.ending; });
}

}  // namespace

std::vector<SequenceRow> sequence(const Cell& cell) {
  std::vector<SequenceRow> out;
  out.push_back({"Stopped", "1", "the pallet is in its place, guards are closed", "nothing moves", "START: Working"});
  out.push_back({"Working", "2, 3", "on entering", "start the belts, make the machines ready", ""});
  for (const bool ending : {false, true}) {
    for (const Task& task : cell.tasks) {
      if (ending ? !task.ending : !task.working) continue;
      out.push_back({ending ? "Ending" : "Working", task.step > 0 ? fmt::format("{}", task.step) : "",
                     condition_of(cell, task), action_of(cell, task), ""});
    }
    if (!ending) {
      for (const Conveyor& c : cell.conveyors)
        if (c.sensor >= 0)
          out.push_back({"Working", "", fmt::format("the sensor of {} sees an item", c.name),
                         fmt::format("{} stands until it is taken", c.name), ""});
      out.push_back({"Working", "7", "END is pressed", "", "Ending"});
      out.push_back({"Working", "13", "no container is left in pallets and holders",
                     "belts stop, machines go home, the operator is asked to refill", "Refill"});
      if (!ends(cell)) break;
    }
  }
  out.push_back({"Ending", "10", "holders are empty and machines idle", "belts stop, machines go home", "Waiting"});
  out.push_back({"Waiting", "11, 12", "guards are closed and START is pressed", "", "Working"});
  out.push_back({"Refill", "14", "the pallet is full again, guards are closed and START is pressed", "", "Working"});
  out.push_back({"any", "", "STOP is pressed or a guard opens",
                 fmt::format("stop of category {}: belts and machines stand", cell.stop_category), "START goes on"});
  return out;
}

StateChart state_chart(const Cell& cell) {
  // The same press clears Halted: a state with work is never entered while everything stands.
  constexpr const char* kStart = "StartPressed AND GuardsClosed AND NOT StopPressed";
  std::string idle = "HoldersEmpty";
  Identifiers names;
  for (const Machine& m : cell.machines) idle += fmt::format(" AND {} = 0", names.of("", m.name, "Task"));
  return {{"Stopped", "Working", "Ending", "Waiting", "Refill"},
          {{"Stopped", "Working", kStart, "START"},
           {"Working", "Ending", "EndPressed", "END"},
           {"Working", "Refill", "AllServed", "no container is left"},
           {"Ending", "Waiting", idle, "holders empty, machines idle"},
           {"Waiting", "Working", kStart, "START"},
           {"Refill", "Working", std::string("Refilled AND ") + kStart, "refilled and START"}}};
}

}  // namespace polypod::cell
