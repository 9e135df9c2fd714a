// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "reader.hpp"

namespace polypod::cell {

Result<Cell> Reader::read(const std::string& file) {
  cell_.file = file;
  POLYPOD_TRY(head());
  POLYPOD_TRY(item());
  POLYPOD_TRY(container());
  POLYPOD_TRY(conveyors());
  POLYPOD_TRY(cameras());
  POLYPOD_TRY(sources());
  POLYPOD_TRY(spots());
  POLYPOD_TRY(machines(file));
  POLYPOD_TRY(tasks());
  POLYPOD_TRY(commands());
  POLYPOD_TRY(bodies());
  POLYPOD_TRY(guards());
  POLYPOD_TRY(cost());
  POLYPOD_TRY(planning());
  POLYPOD_TRY(top_.finish());
  if (cell_.machines.empty() || cell_.tasks.empty()) {
    return fail("CE100", "a cell needs a machine and a task", {file, 0, 0},
                "add [[machine]] and [[task]], as docs/cell.md shows");
  }
  POLYPOD_TRY(together());
  return std::move(cell_);
}

Status Reader::head() {
  POLYPOD_ASSIGN(name, top_.text("name"));
  POLYPOD_ASSIGN(description, top_.optional_text("description", ""));
  POLYPOD_ASSIGN(minutes, top_.optional_number("minutes", 10, {0, 1e5, true, false}));
  POLYPOD_ASSIGN(seed, top_.optional_integer("seed", 1, 0, std::numeric_limits<int>::max()));
  POLYPOD_ASSIGN(policy, top_.optional_text("policy", "first"));
  POLYPOD_ASSIGN(door, optional_length(top_, "door_mm", 0));
  POLYPOD_ASSIGN(response, optional_ms(top_, "control_response_ms", 0));
  POLYPOD_ASSIGN(clearance, optional_length(top_, "clearance_mm", cell_.clearance));
  POLYPOD_ASSIGN(open_sides, top_.optional_text("open_sides", ""));
  POLYPOD_ASSIGN(refill, top_.optional_number("refill_s", -1, kSeconds));
  POLYPOD_ASSIGN(category, top_.optional_text("stop_category", "1"));
  if (policy != "first" && policy != "nearest" && policy != "look-ahead") {
    return fail("CE102", fmt::format("policy \"{}\" is not known", one_line(policy)), top_.place_of("policy"),
                "first, nearest or look-ahead");
  }
  if (category != "0" && category != "1" && category != "2") {
    return fail("CE102", fmt::format("stop_category \"{}\" is not known", one_line(category)),
                top_.place_of("stop_category"), "\"0\", \"1\" or \"2\" (IEC 60204-1)");
  }
  cell_.name = name;
  cell_.description = description;
  cell_.minutes = minutes;
  cell_.seed = seed;
  cell_.policy = policy;
  cell_.door = door;
  cell_.control_response = response;
  cell_.control_response_given = top_.has("control_response_ms");
  cell_.clearance = clearance;
  cell_.open_sides = open_sides;
  cell_.refill = refill;
  cell_.stop_category = category;
  POLYPOD_ASSIGN(notes, top_.optional_table("assumptions"));
  if (notes) {
    for (const std::string& key : notes->keys()) {
      POLYPOD_ASSIGN(note, notes->text(key));
      cell_.assumptions.emplace_back(key, note);
    }
    POLYPOD_TRY(notes->finish());
  }
  return {};
}

Result<std::vector<Table>> Reader::some(std::string_view key) {
  POLYPOD_ASSIGN(tables, top_.tables(key));
  const std::size_t most = key == "machine" || key == "conveyor"                ? 20
                           : key == "task" || key == "spot" || key == "station" ? 50
                                                                                : 1000;
  if (tables.size() > most) {
    return fail("CE106", fmt::format("{} tables [[{}]] are more than {}", tables.size(), key, most),
                tables[most].place(), "join or leave out some, or make two cells of them");
  }
  return tables;
}

Status Reader::fresh_name(const Table& table, std::string& out) {
  POLYPOD_ASSIGN(name, table.text("name"));
  if (name.empty() || name.size() > 60 || one_line(name) != name) {
    return fail("CE101",
                "a name must have 1 to 60 bytes of UTF-8, without control characters, ends of lines and marks of the "
                "direction of writing",
                table.place_of("name"));
  }
  if (!names_.insert(name).second) {
    return fail("CE101", fmt::format("the name \"{}\" stands twice", name), table.place_of("name"),
                "each part of a cell has a name of its own");
  }
  out = name;
  return {};
}

Status Reader::together() {
  for (const Conveyor& c : cell_.conveyors) {
    const auto named = [&](const Body& b) { return b.name == c.chute; };
    if (c.chute.empty() || std::any_of(cell_.bodies.begin(), cell_.bodies.end(), named)) continue;
    return fail("CE102", fmt::format("the chute \"{}\" of conveyor {} is no body", one_line(c.chute), c.name), c.place,
                "add a [[body]] of that name");
  }
  for (const Machine& machine : cell_.machines) {
    for (const std::string& name : machine.mounted_on) {
      std::vector<std::string> known;
      for (const Body& b : cell_.bodies) known.push_back(b.name);
      for (const Spot& s : cell_.spots) known.push_back(s.name);
      for (const Conveyor& c : cell_.conveyors) known.push_back(c.name);
      if (std::find(known.begin(), known.end(), name) != known.end()) continue;
      return fail("CE102",
                  fmt::format("{} is mounted on \"{}\": there is no body of that name", machine.name, one_line(name)),
                  machine.place, did_you_mean(name, known) + fmt::format("known here: {}", fmt::join(known, ", ")));
    }
  }
  // A pour spot or source must come before a window where the items are taken, or they never reach it.
  for (const Task& task : cell_.tasks) {
    if (task.from_conveyor < 0) continue;
    bool any = false;
    for (const Source& source : cell_.sources) any |= reaches(source.conveyor, source.at, task);
    for (const Spot& spot : cell_.spots)
      if (spot.kind == Spot::Kind::pour) any |= reaches(spot.conveyor, spot.along_low, task);
    if (!any) {
      return fail("CE105",
                  fmt::format("no item reaches the window of task {} on conveyor {}", task.name,
                              cell_.conveyors[static_cast<std::size_t>(task.from_conveyor)].name),
                  task.place,
                  "belts run forward: a source or a place where containers are emptied must lie before the window");
    }
  }
  return {};
}

bool Reader::reaches(int conveyor, double along, const Task& task) const {
  std::set<int> seen;
  while (seen.insert(conveyor).second) {
    if (conveyor == task.from_conveyor && along < task.window_high) return true;
    const Conveyor& c = cell_.conveyors[static_cast<std::size_t>(conveyor)];
    if (c.onto.empty()) return false;
    for (std::size_t i = 0; i < cell_.conveyors.size(); ++i)
      if (cell_.conveyors[i].name == c.onto) conveyor = static_cast<int>(i);
    along = on_belt(cell_.conveyors[static_cast<std::size_t>(conveyor)], c.point(c.length + c.drop, 0)).first;
  }
  return false;
}

std::string by_number(const Table& top, const std::string& key) {
  const std::size_t dot = key.find('.');
  if (dot == std::string::npos) return key;
  const std::string kind = key.substr(0, dot), rest = key.substr(dot + 1);
  const Result<std::vector<Table>> tables = top.tables(kind);
  if (!tables) return key;
  for (std::size_t i = 0; i < tables->size(); ++i) {
    const Result<std::string> name = (*tables)[i].text("name");
    if (name && rest.size() > name->size() && rest.compare(0, name->size(), *name) == 0 && rest[name->size()] == '.') {
      return fmt::format("{}[{}]{}", kind, i + 1, rest.substr(name->size()));
    }
  }
  return key;
}

Status override_numbers(Table& top, const std::vector<Override>& overrides) {
  for (const Override& o : overrides) {
    char* end = nullptr;
    const double value = std::strtod(o.value.c_str(), &end);
    if (o.value.empty() || *end != '\0' || !std::isfinite(value)) {
      return fail("CE108", fmt::format("--set {}={}: not a finite number", one_line(o.key), one_line(o.value)));
    }
    if (!top.replace(by_number(top, o.key), value)) {
      return fail("CE108", fmt::format("--set {}: the cell has no such number", one_line(o.key)), {},
                  "name it as conveyor.A.speed_mm_per_s, or conveyor[1].speed_mm_per_s");
    }
  }
  return {};
}

namespace {

Result<Cell> from_table(Table top, const std::string& file, const std::vector<Override>& overrides) {
  POLYPOD_TRY(override_numbers(top, overrides));
  return Reader(top).read(file);
}

}  // namespace

double Cost::total() const {
  double sum = 0;
  for (const CostRow& row : rows) sum += row.sum();
  return sum;
}

Result<Cell> read(const std::string& path, const std::vector<Override>& overrides) {
  POLYPOD_ASSIGN(top, config::read_file(path));
  return from_table(std::move(top), path, overrides);
}

Result<Cell> from_text(std::string_view toml, const std::string& file, const std::vector<Override>& overrides) {
  POLYPOD_ASSIGN(top, config::parse(toml, file));
  return from_table(std::move(top), file, overrides);
}

const char* name_of(Order order) {
  switch (order) {
    case Order::start:
      return "START";
    case Order::stop:
      return "STOP";
    case Order::serve:
      return "SERVE";
    case Order::end:
      break;
  }
  return "END";
}
const char* name_of(Spot::Kind kind) {
  switch (kind) {
    case Spot::Kind::pallet:
      return "pallet";
    case Spot::Kind::holder:
      return "holder";
    case Spot::Kind::opening:
      return "opening";
    case Spot::Kind::pour:
      break;
  }
  return "pour";
}
const char* name_of(Guard::Kind kind) {
  switch (kind) {
    case Guard::Kind::fence:
      return "fence";
    case Guard::Kind::curtain:
      return "light curtain";
    case Guard::Kind::scanner:
      break;
  }
  return "scanner";
}

}  // namespace polypod::cell
