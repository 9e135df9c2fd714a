// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cell/sequence.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <set>

namespace polypod::cell {
namespace {

/// Names as identifiers, each once.
class Names {
 public:
  std::string of(const std::string& name) {
    std::string out;
    bool upper = true;
    for (const char c : name) {
      const bool letter = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'), digit = c >= '0' && c <= '9';
      if (!letter && !digit) {
        upper = true;
        continue;
      }
      out += upper && c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
      upper = false;
    }
    if (out.empty() || (out[0] >= '0' && out[0] <= '9')) out = "N" + out;
    return out;
  }
};

std::string plain(const std::string& text) {
  std::string out;
  for (const char c : text) out += c == '*' || c == '(' || c == ')' || static_cast<unsigned char>(c) >= 0x80 ? ' ' : c;
  return out;
}

const Spot& spot_of(const Cell& cell, int index) {
  return cell.spots[static_cast<std::size_t>(index)];
}

std::string source_name(const Cell& cell, const Task& task) {
  return task.from_conveyor >= 0 ? cell.conveyors[static_cast<std::size_t>(task.from_conveyor)].name
                                 : spot_of(cell, task.from).name;
}

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
  out.push_back({"Waiting", "11, 12", "START is pressed", "", "Working"});
  out.push_back({"Refill", "14", "the pallet is full again and START is pressed", "", "Working"});
  out.push_back({"any", "", "STOP is pressed or a guard opens",
                 fmt::format("stop of category {}: belts and machines stand", cell.stop_category), "START goes on"});
  return out;
}

std::string structured_text(const Cell& cell) {
  Names names;
  std::string out;
  const auto line = [&](int depth, const std::string& text) {
    out += std::string(static_cast<std::size_t>(2 * depth), ' ') + text + "\n";
  };
  const std::string program = names.of(cell.name);
  line(0, fmt::format("(* {}: sequence of the cell. A frame: bind inputs and outputs, and let the safety controller, "
                      "not this program, stop the drives. *)",
                      plain(cell.name)));
  line(0, "TYPE");
  line(1, "CellState : (Stopped, Working, Ending, Waiting, Refill);");
  line(0, "END_TYPE");
  line(0, "");
  line(0, fmt::format("PROGRAM {}", program));
  line(0, "VAR_INPUT");
  line(1, "StartPressed, StopPressed, ServePressed, EndPressed, GuardsClosed, Refilled : BOOL;");
  for (const Conveyor& c : cell.conveyors) {
    if (c.sensor >= 0) line(1, fmt::format("SensorOf{} : BOOL;", names.of(c.name)));
  }
  for (const Task& t : cell.tasks)
    line(1, fmt::format("Can{} : BOOL; (* {} *)", names.of(t.name), plain(condition_of(cell, t))));
  for (const Machine& m : cell.machines)
    line(1, fmt::format("{}Done : BOOL; (* its task has ended *)", names.of(m.name)));
  line(1, "AllServed, HoldersEmpty : BOOL;");
  line(0, "END_VAR");
  line(0, "VAR_OUTPUT");
  for (const Conveyor& c : cell.conveyors) line(1, fmt::format("Run{} : BOOL;", names.of(c.name)));
  for (const Machine& m : cell.machines) line(1, fmt::format("{0}Task : INT; {0}Home : BOOL;", names.of(m.name)));
  line(1, "AskForRefill : BOOL;");
  line(0, "END_VAR");
  line(0, "VAR");
  line(1, "State : CellState := Stopped;");
  line(1, "Halted : BOOL; ServePending : INT;");
  std::set<std::string> zones;
  for (const Spot& s : cell.spots)
    if (!s.zone.empty()) zones.insert(s.zone);
  for (const std::string& zone : zones)
    line(1, fmt::format(
                "Zone{} : INT; (* 0: free, else the machine that holds it; machines ask for it and give it back *)",
                names.of(zone)));
  line(0, "END_VAR");
  line(0, "");
  line(0, "IF ServePressed THEN ServePending := ServePending + 1; END_IF;");
  line(0, "IF StopPressed OR NOT GuardsClosed THEN Halted := TRUE; END_IF;");
  line(0, "IF StartPressed AND GuardsClosed THEN Halted := FALSE; END_IF;");
  line(0, "");
  line(0, "CASE State OF");
  line(1, "Stopped, Waiting:");
  line(2, "IF StartPressed AND GuardsClosed THEN State := Working; END_IF;");
  line(1, "Working:");
  line(2, "IF EndPressed THEN State := Ending; ELSIF AllServed THEN State := Refill; END_IF;");
  line(1, "Ending:");
  std::string idle;
  for (const Machine& m : cell.machines) idle += fmt::format(" AND {}Task = 0", names.of(m.name));
  line(2, fmt::format("IF HoldersEmpty{} THEN State := Waiting; END_IF;", idle));
  line(1, "Refill:");
  line(2, "IF Refilled AND StartPressed THEN State := Working; END_IF;");
  line(0, "END_CASE;");
  line(0, "AskForRefill := State = Refill;");
  line(0, "");
  for (const Conveyor& c : cell.conveyors) {
    line(0, fmt::format("Run{0} := (State = Working OR State = Ending) AND NOT Halted{1};", names.of(c.name),
                        c.sensor >= 0 ? fmt::format(" AND NOT SensorOf{}", names.of(c.name)) : ""));
  }
  for (std::size_t m = 0; m < cell.machines.size(); ++m) {
    const std::string name = names.of(cell.machines[m].name);
    line(0, "");
    line(0, fmt::format("(* {}: tasks in the order of their priority *)", plain(cell.machines[m].name)));
    line(0, fmt::format("IF {0}Done THEN {0}Task := 0; END_IF;", name));
    line(0, fmt::format("IF {}Task = 0 AND NOT Halted THEN", name));
    bool first = true;
    for (std::size_t t = 0; t < cell.tasks.size(); ++t) {
      const Task& task = cell.tasks[t];
      if (task.machine != static_cast<int>(m)) continue;
      const std::string state = task.working && task.ending ? "(State = Working OR State = Ending)"
                                : task.working              ? "State = Working"
                                                            : "State = Ending";
      line(1, fmt::format("{} {} AND Can{}{} THEN", first ? "IF" : "ELSIF", state, names.of(task.name),
                          task.on_serve ? " AND ServePending > 0" : ""));
      line(2, fmt::format("{}Task := {}; (* {} *){}", name, t + 1, plain(task.name),
                          task.on_serve ? " ServePending := ServePending - 1;" : ""));
      first = false;
    }
    if (!first) line(1, "END_IF;");
    line(0, "END_IF;");
    line(0, fmt::format("{0}Home := {0}Task = 0 AND NOT (State = Working OR State = Ending);", name));
  }
  line(0, "END_PROGRAM");
  return out;
}

}  // namespace polypod::cell
