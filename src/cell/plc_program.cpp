// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The program for the PLC, as Structured Text and as PLCopen XML.
#include "plc_program.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>

namespace polypod::cell {
namespace {

std::string small(std::string text) {
  for (char& c : text)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return text;
}

/// Keywords of IEC 61131-3 that a name could be, and what the program itself declares.
constexpr std::array kTaken{"action",
                            "and",
                            "any",
                            "array",
                            "at",
                            "bool",
                            "by",
                            "byte",
                            "case",
                            "class",
                            "configuration",
                            "constant",
                            "dint",
                            "do",
                            "dword",
                            "else",
                            "elsif",
                            "end",
                            "exit",
                            "false",
                            "for",
                            "from",
                            "function",
                            "if",
                            "initial",
                            "initialstep",
                            "int",
                            "interface",
                            "interval",
                            "lint",
                            "lreal",
                            "method",
                            "mod",
                            "namespace",
                            "non",
                            "not",
                            "of",
                            "on",
                            "or",
                            "overlap",
                            "priority",
                            "program",
                            "property",
                            "read",
                            "real",
                            "refto",
                            "repeat",
                            "resource",
                            "retain",
                            "return",
                            "sint",
                            "single",
                            "step",
                            "string",
                            "struct",
                            "super",
                            "task",
                            "then",
                            "this",
                            "time",
                            "to",
                            "transition",
                            "true",
                            "type",
                            "udint",
                            "uint",
                            "until",
                            "usint",
                            "using",
                            "var",
                            "while",
                            "with",
                            "word",
                            "wstring",
                            "xor",
                            "cellstate",
                            "cellstates",
                            "state",
                            "states",
                            "halted",
                            "servepending",
                            "startpressed",
                            "stoppressed",
                            "servepressed",
                            "endpressed",
                            "guardsclosed",
                            "refilled",
                            "allserved",
                            "holdersempty",
                            "askforrefill",
                            "stopped",
                            "working",
                            "ending",
                            "waiting",
                            "refill",
                            "servewaspressed"};

}  // namespace

Identifiers::Identifiers() : taken_(kTaken.begin(), kTaken.end()) {}

std::string Identifiers::of(const std::string& prefix, const std::string& name, const std::string& suffix) {
  const auto key = std::tuple{prefix, name, suffix};
  if (const auto at = given_.find(key); at != given_.end()) return at->second;
  std::string middle;
  bool upper = true;
  for (const char c : name) {
    const bool letter = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'), digit = c >= '0' && c <= '9';
    if (!letter && !digit) {
      upper = true;
      continue;
    }
    middle += upper && c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
    upper = false;
  }
  if (middle.empty() || (prefix.empty() && middle[0] >= '0' && middle[0] <= '9')) middle = "N" + middle;
  std::string out = prefix + middle + suffix;
  for (int n = 2; !taken_.insert(small(out)).second; ++n)
    out = fmt::format("{}{}_{}{}{}", prefix, middle, n, suffix.empty() ? "" : "_", suffix);
  given_.emplace(key, out);
  return out;
}

std::string comment_text(const std::string& text) {
  std::string out;
  for (const char c : text) {
    const auto u = static_cast<unsigned char>(c);
    out += c == '*' || c == '(' || c == ')' || u < 0x20 || u >= 0x7f ? ' ' : c;
  }
  return out;
}

/// The machines, in their order, whose tasks come into a zone.
std::vector<std::size_t> users_of(const Cell& cell, const std::string& zone) {
  std::vector<std::size_t> out;
  for (std::size_t m = 0; m < cell.machines.size(); ++m) {
    const bool comes = std::any_of(cell.tasks.begin(), cell.tasks.end(), [&](const Task& t) {
      const auto in = [&](int spot) { return spot >= 0 && cell.spots[static_cast<std::size_t>(spot)].zone == zone; };
      return t.machine == static_cast<int>(m) && (in(t.from) || in(t.via) || in(t.to));
    });
    if (comes) out.push_back(m);
  }
  return out;
}

PlcProgram plc_program(const Cell& cell, std::string (*in_state)(const std::string& state)) {
  using Section = PlcVariable::Section;
  PlcProgram out;
  Identifiers names;
  // Machines first: the chart of states names their tasks.
  std::vector<std::string> tasks_of;
  for (const Machine& m : cell.machines) tasks_of.push_back(names.of("", m.name, "Task"));
  out.name = names.of("", cell.name, "");
  const auto add = [&](Section section, const std::string& name, const char* type, const std::string& comment = "",
                       const std::string& initial = "") {
    out.variables.push_back({section, name, type, initial, comment_text(comment)});
  };
  for (const char* name : {"StartPressed", "StopPressed", "ServePressed", "EndPressed", "GuardsClosed", "Refilled"})
    add(Section::input, name, "BOOL");
  for (const Conveyor& c : cell.conveyors)
    if (c.sensor >= 0) add(Section::input, names.of("SensorOf", c.name, ""), "BOOL");
  for (const Task& t : cell.tasks) add(Section::input, names.of("Can", t.name, ""), "BOOL", condition_of(cell, t));
  for (const Machine& m : cell.machines)
    add(Section::input, names.of("", m.name, "Done"), "BOOL", "its task has ended");
  std::set<std::string> zones;
  for (const Spot& s : cell.spots)
    if (!s.zone.empty()) zones.insert(s.zone);
  const auto machine_in = [&](std::size_t m, const char* verb, const std::string& zone) {
    return names.of(names.of("", cell.machines[m].name, verb), zone, "");
  };
  for (const std::string& zone : zones)
    for (const std::size_t m : users_of(cell, zone))
      add(Section::input, machine_in(m, "Needs", zone), "BOOL",
          "from before it enters the zone until it has left it, as its program says");
  add(Section::input, "AllServed", "BOOL");
  add(Section::input, "HoldersEmpty", "BOOL");
  for (const Conveyor& c : cell.conveyors) add(Section::output, names.of("Run", c.name, ""), "BOOL");
  for (std::size_t m = 0; m < cell.machines.size(); ++m) {
    add(Section::output, tasks_of[m], "INT", "number of its task; 0: none");
    add(Section::output, names.of("", cell.machines[m].name, "Home"), "BOOL", "it goes home");
  }
  for (const std::string& zone : zones)
    for (const std::size_t m : users_of(cell, zone))
      add(Section::output, machine_in(m, "May", zone), "BOOL", "it may enter; it waits outside until then");
  add(Section::output, "AskForRefill", "BOOL");
  add(Section::local, "Halted", "BOOL", "after STOP, until START", "TRUE");
  add(Section::local, "ServePending", "INT", "times SERVE was pressed and not yet done");
  add(Section::local, "ServeWasPressed", "BOOL");
  for (const std::string& zone : zones) {
    add(Section::local, names.of("Zone", zone, ""), "INT", "0: free, else the number of the machine that holds it");
    for (const std::size_t m : users_of(cell, zone))
      add(Section::local, machine_in(m, "Waits", zone), "INT", "cycles that it has waited, up to 30000");
  }

  out.before = {"IF ServePressed AND NOT ServeWasPressed THEN ServePending := ServePending + 1; END_IF;",
                "ServeWasPressed := ServePressed;", "IF StartPressed AND GuardsClosed THEN Halted := FALSE; END_IF;",
                "IF StopPressed OR NOT GuardsClosed THEN Halted := TRUE; END_IF;"};
  const std::string runs = fmt::format("({} OR {})", in_state("Working"), in_state("Ending"));
  auto& lines = out.after;
  lines.push_back(fmt::format("AskForRefill := {};", in_state("Refill")));
  lines.emplace_back();
  for (const Conveyor& c : cell.conveyors) {
    lines.push_back(fmt::format("{} := {} AND NOT Halted{};", names.of("Run", c.name, ""), runs,
                                c.sensor >= 0 ? " AND NOT " + names.of("SensorOf", c.name, "") : ""));
  }
  for (std::size_t m = 0; m < cell.machines.size(); ++m) {
    const std::string &name = cell.machines[m].name, &number = tasks_of[m];
    lines.emplace_back();
    lines.push_back(fmt::format("(* {}: tasks in the order of their priority *)", comment_text(name)));
    lines.push_back(fmt::format("IF {} THEN {} := 0; END_IF;", names.of("", name, "Done"), number));
    bool first = true;
    for (std::size_t t = 0; t < cell.tasks.size(); ++t) {
      const Task& task = cell.tasks[t];
      if (task.machine != static_cast<int>(m)) continue;
      if (first) lines.push_back(fmt::format("IF {} = 0 AND NOT Halted THEN", number));
      const std::string state = task.working && task.ending ? runs
                                : task.working              ? in_state("Working")
                                                            : in_state("Ending");
      lines.push_back(fmt::format("  {} {} AND {}{} THEN", first ? "IF" : "ELSIF", state,
                                  names.of("Can", task.name, ""), task.on_serve ? " AND ServePending > 0" : ""));
      lines.push_back(fmt::format("    {} := {}; (* {} *){}", number, t + 1, comment_text(task.name),
                                  task.on_serve ? " ServePending := ServePending - 1;" : ""));
      first = false;
    }
    if (!first) {
      lines.emplace_back("  END_IF;");
      lines.emplace_back("END_IF;");
    }
    lines.push_back(fmt::format("{} := {} = 0 AND NOT {};", names.of("", name, "Home"), number, runs));
  }
  // Interlocks: who has left gives a zone back, and who has waited longest takes it.
  for (const std::string& zone : zones) {
    const std::vector<std::size_t> users = users_of(cell, zone);
    const std::string holder = names.of("Zone", zone, "");
    lines.emplace_back();
    lines.push_back(fmt::format("(* {}: one machine at a time *)", comment_text(zone)));
    for (const std::size_t m : users)
      lines.push_back(fmt::format("IF {} = {} AND NOT {} THEN {} := 0; END_IF;", holder, m + 1,
                                  machine_in(m, "Needs", zone), holder));
    for (const std::size_t m : users) {
      std::string first;
      for (const std::size_t other : users)
        if (other != m)
          first += fmt::format(" AND NOT ({} AND {} > {})", machine_in(other, "Needs", zone),
                               machine_in(other, "Waits", zone), machine_in(m, "Waits", zone));
      lines.push_back(fmt::format("IF {} = 0 AND {}{} THEN {} := {}; END_IF;", holder, machine_in(m, "Needs", zone),
                                  first, holder, m + 1));
    }
    for (const std::size_t m : users) {
      const std::string waits = machine_in(m, "Waits", zone);
      lines.push_back(fmt::format("{} := {} = {};", machine_in(m, "May", zone), holder, m + 1));
      lines.push_back(
          fmt::format("IF {} AND NOT {} THEN IF {} < 30000 THEN {} := {} + 1; END_IF; ELSE {} := 0; END_IF;",
                      machine_in(m, "Needs", zone), machine_in(m, "May", zone), waits, waits, waits, waits));
    }
  }
  return out;
}

std::string structured_text(const Cell& cell) {
  using Section = PlcVariable::Section;
  const PlcProgram program = plc_program(cell, [](const std::string& state) { return "State = " + state; });
  const StateChart chart = state_chart(cell);
  std::string out;
  const auto line = [&](int depth, const std::string& text) {
    if (!text.empty()) out += std::string(static_cast<std::size_t>(2 * depth), ' ') + text;
    out += '\n';
  };
  line(0, fmt::format("(* {}: sequence of the cell. A frame: bind inputs and outputs, and let the safety controller, "
                      "not this program, stop the drives. *)",
                      comment_text(cell.name)));
  line(0, "TYPE");
  std::string states;
  for (const std::string& state : chart.states) states += (states.empty() ? "" : ", ") + state;
  line(1, fmt::format("CellState : ({});", states));
  line(0, "END_TYPE");
  line(0, "");
  line(0, fmt::format("PROGRAM {}", program.name));
  for (const auto& [section, word] : {std::pair{Section::input, "VAR_INPUT"}, std::pair{Section::output, "VAR_OUTPUT"},
                                      std::pair{Section::local, "VAR"}}) {
    line(0, word);
    if (section == Section::local) line(1, fmt::format("State : CellState := {};", chart.states.front()));
    for (const PlcVariable& v : program.variables) {
      if (v.section != section) continue;
      line(1, fmt::format("{} : {}{};{}", v.name, v.type, v.initial.empty() ? "" : " := " + v.initial,
                          v.comment.empty() ? "" : fmt::format(" (* {} *)", v.comment)));
    }
    line(0, "END_VAR");
  }
  line(0, "");
  for (const std::string& text : program.before) line(0, text);
  line(0, "");
  line(0, "CASE State OF");
  for (const std::string& state : chart.states) {
    line(1, state + ":");
    std::string text;
    for (const Transition& t : chart.transitions) {
      if (t.from != state) continue;
      text += fmt::format("{} {} THEN State := {};", text.empty() ? "IF" : " ELSIF", t.condition, t.to);
    }
    line(2, text + " END_IF;");
  }
  line(0, "END_CASE;");
  for (const std::string& text : program.after) line(0, text);
  line(0, "END_PROGRAM");
  return out;
}

}  // namespace polypod::cell
