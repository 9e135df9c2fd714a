// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "polypod/cell/cell.hpp"
#include "polypod/core/config.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/nearest_word.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod::cell {
namespace {

using config::Range;
using config::Table;

constexpr Range kSize_mm{0, 1e5, true, false};  // up to 100 m
constexpr Range kMaybeSize_mm{0, 1e5};
constexpr Range kPlace_mm{-1e5, 1e5};
constexpr Range kAngle_deg{-3600, 3600};
constexpr Range kSpeed{0, 1e7, true, false};  // mm/s or deg/s and their derivatives are far below
constexpr Range kDerivative{0, 1e12, true, false};
constexpr Range kSeconds{0, 1e6};
constexpr Range kMilliseconds{0, 1e6};
constexpr Range kMoney{0, 1e12};
constexpr int kMostItems = 1'000'000, kMostSlots = 1000, kMostParts = 1000;

Result<Vec3> point(const Table& table, std::string_view key, double third = 0) {
  POLYPOD_ASSIGN(v, table.numbers(key, 0, kPlace_mm));
  if (v.size() == 2) v.push_back(units::to_mm(third));
  if (v.size() != 3) {
    return fail("CF105", fmt::format("{} has {} numbers; a point has 3: x, y, z", key, v.size()), table.place_of(key));
  }
  return Vec3(units::from_mm(v[0]), units::from_mm(v[1]), units::from_mm(v[2]));
}
Result<Vec3> optional_point(const Table& table, std::string_view key, const Vec3& otherwise) {
  if (!table.has(key)) return otherwise;
  return point(table, key);
}
Result<std::array<double, 2>> span(const Table& table, std::string_view key, double factor, Range range) {
  POLYPOD_ASSIGN(v, table.numbers(key, 2, range));
  return std::array{v[0] * factor, v[1] * factor};
}
Status ordered(const Table& table, std::string_view key, double low, double high) {
  if (low <= high) return {};
  return fail("CE105", fmt::format("{}: the first number is above the second", key), table.place_of(key),
              "give the lower end first");
}

/// A number of the table in mm, as m.
Result<double> length(const Table& table, std::string_view key, Range range = kSize_mm) {
  POLYPOD_ASSIGN(v, table.number(key, range));
  return units::from_mm(v);
}
Result<double> optional_length(const Table& table, std::string_view key, double otherwise,
                               Range range = kMaybeSize_mm) {
  POLYPOD_ASSIGN(v, table.optional_number(key, units::to_mm(otherwise), range));
  return units::from_mm(v);
}
Result<double> optional_angle(const Table& table, std::string_view key, double otherwise) {
  POLYPOD_ASSIGN(v, table.optional_number(key, units::to_deg(otherwise), kAngle_deg));
  return units::from_deg(v);
}
Result<double> optional_ms(const Table& table, std::string_view key, double otherwise) {
  POLYPOD_ASSIGN(v, table.optional_number(key, otherwise * 1e3, kMilliseconds));
  return units::from_ms(v);
}

/// The index of a name in a list of things with names.
template <class T>
Result<int> index_of(const std::vector<T>& things, const Table& table, std::string_view key, const char* what) {
  POLYPOD_ASSIGN(name, table.text(key));
  std::vector<std::string> known;
  for (std::size_t i = 0; i < things.size(); ++i) {
    if (things[i].name == name) return static_cast<int>(i);
    known.push_back(things[i].name);
  }
  return fail("CE102", fmt::format("{} \"{}\": there is no {} of that name", key, one_line(name), what),
              table.place_of(key),
              known.empty() ? fmt::format("the cell has no {}", what)
                            : did_you_mean(name, known) + fmt::format("known here: {}", fmt::join(known, ", ")));
}

class Reader {
 public:
  explicit Reader(Table& top) : top_(top) {}

  Result<Cell> read(const std::string& file) {
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

 private:
  Status head() {
    POLYPOD_ASSIGN(name, top_.text("name"));
    POLYPOD_ASSIGN(description, top_.optional_text("description", ""));
    POLYPOD_ASSIGN(minutes, top_.optional_number("minutes", 10, {0, 1e5, true, false}));
    POLYPOD_ASSIGN(seed, top_.optional_integer("seed", 1, 0, std::numeric_limits<int>::max()));
    POLYPOD_ASSIGN(policy, top_.optional_text("policy", "first"));
    POLYPOD_ASSIGN(door, optional_length(top_, "door_mm", 0));
    POLYPOD_ASSIGN(response, optional_ms(top_, "control_response_ms", 0));
    POLYPOD_ASSIGN(clearance, optional_length(top_, "clearance_mm", cell_.clearance));
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
    cell_.clearance = clearance;
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

  /// The tables of a kind, not more than a cell can sensibly have.
  Result<std::vector<Table>> some(std::string_view key) {
    POLYPOD_ASSIGN(tables, top_.tables(key));
    const std::size_t most = key == "machine" || key == "conveyor"                ? 20
                             : key == "task" || key == "spot" || key == "station" ? 50
                                                                                  : 1000;
    if (tables.size() > most) {
      return fail("CE106", fmt::format("{} tables [[{}]] are more than {}", tables.size(), key, most),
                  tables[most].place());
    }
    return tables;
  }

  Status fresh_name(const Table& table, std::string& out) {
    POLYPOD_ASSIGN(name, table.text("name"));
    if (name.empty() || name.size() > 60 || one_line(name) != name) {
      return fail("CE101", "a name must have 1 to 60 characters on one line", table.place_of("name"));
    }
    if (!names_.insert(name).second) {
      return fail("CE101", fmt::format("the name \"{}\" stands twice", name), table.place_of("name"),
                  "each part of a cell has a name of its own");
    }
    out = name;
    return {};
  }

  Status item() {
    POLYPOD_ASSIGN(table, top_.optional_table("item"));
    if (!table) return {};
    Item out;
    POLYPOD_TRY(fresh_name(*table, out.name));
    POLYPOD_ASSIGN(diameter, length(*table, "diameter_mm"));
    POLYPOD_ASSIGN(height, length(*table, "height_mm"));
    POLYPOD_ASSIGN(mass, table->optional_number("mass_g", 0, {0, 1e9}));
    out.diameter = diameter;
    out.height = height;
    out.mass = mass * 1e-3;
    item_ = *table;
    cell_.items.push_back(out);
    return table->finish();
  }

  Status container() {
    POLYPOD_ASSIGN(table, top_.optional_table("container"));
    if (!table) return {};
    Container out;
    POLYPOD_TRY(fresh_name(*table, out.name));
    POLYPOD_ASSIGN(capacity, table->integer("capacity", 1, kMostItems));
    POLYPOD_ASSIGN(diameter, length(*table, "diameter_mm"));
    POLYPOD_ASSIGN(height, length(*table, "height_mm"));
    POLYPOD_ASSIGN(mass, table->optional_number("mass_g", 0, {0, 1e9}));
    out.capacity = capacity;
    out.diameter = diameter;
    out.height = height;
    out.mass = mass * 1e-3;
    container_ = *table;
    cell_.containers.push_back(out);
    return table->finish();
  }

  Status conveyors() {
    POLYPOD_ASSIGN(tables, some("conveyor"));
    std::vector<std::string> onto;
    for (const Table& table : tables) {
      Conveyor out;
      out.place = table.place();
      POLYPOD_TRY(fresh_name(table, out.name));
      POLYPOD_ASSIGN(at, point(table, "at_mm"));
      POLYPOD_ASSIGN(heading, optional_angle(table, "heading_deg", 0));
      POLYPOD_ASSIGN(long_, length(table, "length_mm"));
      POLYPOD_ASSIGN(width, length(table, "width_mm"));
      POLYPOD_ASSIGN(frame, optional_length(table, "frame_width_mm", width, kSize_mm));
      POLYPOD_ASSIGN(depth, optional_length(table, "depth_mm", 0.1, kSize_mm));
      POLYPOD_ASSIGN(speed, table.number("speed_mm_per_s", {-1e5, 1e5}));
      if (!(speed > 0)) {
        return fail("CE104", fmt::format("conveyor {} runs at {:g} mm/s: a belt must run forward", out.name, speed),
                    table.place_of("speed_mm_per_s"),
                    "give a speed above 0; for the other direction turn heading_deg by 180 and begin at the other end");
      }
      POLYPOD_ASSIGN(power, table.optional_number("power_W", 0, {0, 1e9}));
      POLYPOD_ASSIGN(motor, table.optional_text("motor", ""));
      POLYPOD_ASSIGN(next, table.optional_text("onto", ""));
      POLYPOD_ASSIGN(drop, optional_length(table, "drop_mm", 0));
      POLYPOD_ASSIGN(spread, optional_length(table, "drop_spread_mm", 0));
      POLYPOD_ASSIGN(sensor, optional_length(table, "sensor_mm", -1e-3, {-1, 1e5}));
      if (sensor > long_) {
        return fail("CE105",
                    fmt::format("the sensor at {:g} mm is beyond the end of conveyor {}, {:g} mm", units::to_mm(sensor),
                                out.name, units::to_mm(long_)),
                    table.place_of("sensor_mm"));
      }
      if (frame < width) {
        return fail("CE103", fmt::format("the belt of conveyor {} is wider than its frame", out.name),
                    table.place_of("frame_width_mm"));
      }
      out.at = at;
      out.heading = heading;
      out.length = long_;
      out.width = width;
      out.frame_width = frame;
      out.depth = depth;
      out.speed = units::from_mm(speed);
      out.power = power;
      out.motor = motor;
      out.onto = next;
      out.drop = drop;
      out.drop_spread = spread;
      out.sensor = sensor;
      if (!cell_.items.empty() && cell_.items[0].diameter > width) {
        return fail("CE103",
                    fmt::format("{} of {:g} mm is wider than the belt of conveyor {}, {:g} mm", cell_.items[0].name,
                                units::to_mm(cell_.items[0].diameter), out.name, units::to_mm(width)),
                    table.place_of("width_mm"), "take a wider belt or smaller items");
      }
      POLYPOD_TRY(table.finish());
      cell_.conveyors.push_back(out);
    }
    for (std::size_t i = 0; i < tables.size(); ++i) {
      const Conveyor& c = cell_.conveyors[i];
      if (c.onto.empty()) continue;
      POLYPOD_ASSIGN(next, index_of(cell_.conveyors, tables[i], "onto", "conveyor"));
      const Conveyor& o = cell_.conveyors[static_cast<std::size_t>(next)];
      for (const double drop : {c.drop - c.drop_spread, c.drop + c.drop_spread}) {
        const Vec3 end = c.point(c.length + drop, 0);
        const auto [along, across] = on_belt(o, end);
        if (along < 0 || along > o.length || std::abs(across) > o.width / 2 || end.z() < o.at.z()) {
          return fail("CE107",
                      fmt::format("items leave conveyor {} at x {:.0f}, y {:.0f}, z {:.0f} mm: that is not over the "
                                  "belt of conveyor {}",
                                  c.name, units::to_mm(end.x()), units::to_mm(end.y()), units::to_mm(end.z()), o.name),
                      tables[i].place_of("onto"), "move a conveyor, or change drop_mm and drop_spread_mm");
        }
      }
    }
    return {};
  }

  static std::pair<double, double> on_belt(const Conveyor& c, const Vec3& p) {
    const Vec3 d = p - c.at;
    const double cs = std::cos(c.heading), sn = std::sin(c.heading);
    return {cs * d.x() + sn * d.y(), -sn * d.x() + cs * d.y()};
  }

  Status cameras() {
    POLYPOD_ASSIGN(tables, top_.tables("camera"));
    for (const Table& table : tables) {
      Camera out;
      POLYPOD_TRY(fresh_name(table, out.name));
      POLYPOD_ASSIGN(conveyor, index_of(cell_.conveyors, table, "conveyor", "conveyor"));
      POLYPOD_ASSIGN(at, length(table, "at_mm", kMaybeSize_mm));
      POLYPOD_ASSIGN(across, optional_length(table, "across_mm", 0, kPlace_mm));
      POLYPOD_ASSIGN(field, span(table, "field_mm", units::kMetrePerMm, kSize_mm));
      std::array<double, 2> pixels{};
      if (table.has("pixels")) {
        POLYPOD_ASSIGN(p, span(table, "pixels", 1, {1, 1e6}));
        pixels = p;
      }
      POLYPOD_ASSIGN(interval, optional_ms(table, "interval_ms", 0.1));
      POLYPOD_ASSIGN(delay, optional_ms(table, "delay_ms", 0));
      if (!(interval >= 1e-3)) return fail("CE105", "interval_ms must be 1 or more", table.place_of("interval_ms"));
      for (const Camera& other : cell_.cameras) {
        if (other.conveyor == conveyor)
          return fail("CE101", "a conveyor can have one camera", table.place_of("conveyor"));
      }
      const Conveyor& c = cell_.conveyors[static_cast<std::size_t>(conveyor)];
      if (at - field[0] / 2 < 0 || at + field[0] / 2 > c.length) {
        return fail("CE105", fmt::format("the field of {} is not on conveyor {}", out.name, c.name),
                    table.place_of("at_mm"));
      }
      if (!cell_.items.empty() && std::min(field[0], field[1]) <= cell_.items[0].diameter) {
        return fail("CE103",
                    fmt::format("{} does not see a whole {}: its field is {:g} x {:g} mm", out.name,
                                cell_.items[0].name, units::to_mm(field[0]), units::to_mm(field[1])),
                    table.place_of("field_mm"), "take a wider field");
      }
      out.conveyor = conveyor;
      out.at = at;
      out.across = across;
      out.field_along = field[0];
      out.field_across = field[1];
      out.pixels = pixels;
      out.interval = interval;
      out.delay = delay;
      POLYPOD_TRY(table.finish());
      cell_.cameras.push_back(out);
    }
    return {};
  }

  Status sources() {
    POLYPOD_ASSIGN(tables, some("source"));
    for (const Table& table : tables) {
      Source out;
      POLYPOD_TRY(fresh_name(table, out.name));
      POLYPOD_ASSIGN(conveyor, index_of(cell_.conveyors, table, "conveyor", "conveyor"));
      POLYPOD_ASSIGN(arrival, table.text("arrival"));
      if (arrival == "list") {
        POLYPOD_ASSIGN(times, table.numbers("times_s", 0, kSeconds));
        if (!std::is_sorted(times.begin(), times.end())) {
          return fail("CE105", "times_s must not fall", table.place_of("times_s"));
        }
        out.times = times;
        out.arrival = Source::Arrival::list;
      } else if (arrival == "even" || arrival == "poisson") {
        POLYPOD_ASSIGN(rate, table.number("per_minute", {1e-6, 60000}));
        out.rate = rate / 60;
        out.arrival = arrival == "even" ? Source::Arrival::even : Source::Arrival::poisson;
      } else {
        return fail("CE102", fmt::format("arrival \"{}\" is not known", one_line(arrival)), table.place_of("arrival"),
                    "even, poisson or list");
      }
      POLYPOD_ASSIGN(at, optional_length(table, "at_mm", 0));
      std::array<double, 2> across{};
      if (table.has("across_mm")) {
        POLYPOD_ASSIGN(a, span(table, "across_mm", units::kMetrePerMm, kPlace_mm));
        across = a;
        POLYPOD_TRY(ordered(table, "across_mm", across[0], across[1]));
      }
      POLYPOD_ASSIGN(limit, table.optional_integer("limit", kMostItems, 1, kMostItems));
      POLYPOD_TRY(needs_item(table));
      const Conveyor& c = cell_.conveyors[static_cast<std::size_t>(conveyor)];
      POLYPOD_TRY(on(c, table, "across_mm", across[0], across[1]));
      if (at > c.length)
        return fail("CE105", fmt::format("source {} is beyond the end of conveyor {}", out.name, c.name),
                    table.place_of("at_mm"));
      out.conveyor = conveyor;
      out.at = at;
      out.across_low = across[0];
      out.across_high = across[1];
      out.limit = limit;
      POLYPOD_TRY(table.finish());
      cell_.sources.push_back(out);
    }
    return {};
  }

  Status needs_item(const Table& table) {
    if (!cell_.items.empty()) return {};
    return fail("CE106", "the cell has no [item]", table.place(),
                "add a table [item] with name, diameter_mm and height_mm");
  }
  /// Whether items between these distances from the middle lie on the belt.
  Status on(const Conveyor& c, const Table& table, std::string_view key, double low, double high) {
    const double room = c.width / 2 - cell_.items[0].diameter / 2;
    if (low >= -room - 1e-12 && high <= room + 1e-12) return {};
    return fail(
        "CE103",
        fmt::format(
            "{} of {:g} mm from {:g} to {:g} mm from the middle hang over the belt of conveyor {}, {:g} mm wide",
            cell_.items[0].name, units::to_mm(cell_.items[0].diameter), units::to_mm(low), units::to_mm(high), c.name,
            units::to_mm(c.width)),
        table.has(key) ? table.place_of(key) : table.place(), "take a wider belt, or places nearer to its middle");
  }

  Status spots() {
    POLYPOD_ASSIGN(tables, some("spot"));
    for (const Table& table : tables) {
      Spot out;
      out.place = table.place();
      POLYPOD_TRY(fresh_name(table, out.name));
      POLYPOD_ASSIGN(kind, table.text("kind"));
      if (kind == "pallet")
        out.kind = Spot::Kind::pallet;
      else if (kind == "holder")
        out.kind = Spot::Kind::holder;
      else if (kind == "opening")
        out.kind = Spot::Kind::opening;
      else if (kind == "pour")
        out.kind = Spot::Kind::pour;
      else
        return fail("CE102", fmt::format("kind \"{}\" is not known", one_line(kind)), table.place_of("kind"),
                    "pallet, holder, opening or pour");
      if (cell_.containers.empty())
        return fail("CE106", "the cell has no [container]", table.place(), "add a table [container]");
      POLYPOD_ASSIGN(at, point(table, "at_mm"));
      POLYPOD_ASSIGN(rows, table.optional_integer("rows", 1, 1, 100));
      POLYPOD_ASSIGN(columns, table.optional_integer("columns", 1, 1, 100));
      POLYPOD_ASSIGN(turn, optional_angle(table, "turn_deg", 0));
      double pitch = 0;
      if (rows * columns > kMostSlots) {
        return fail("CE106", fmt::format("{} places are more than {}", rows * columns, kMostSlots),
                    table.place_of("rows"));
      }
      if (rows * columns > 1) {
        POLYPOD_ASSIGN(p, length(table, "pitch_mm"));
        pitch = p;
        if (pitch < cell_.containers[0].diameter) {
          return fail(
              "CE103",
              fmt::format("{} of {:g} mm do not fit side by side at a pitch of {:g} mm", cell_.containers[0].name,
                          units::to_mm(cell_.containers[0].diameter), units::to_mm(pitch)),
              table.place_of("pitch_mm"));
        }
      }
      for (int r = 0; r < rows; ++r) {
        for (int c = 0; c < columns; ++c) {
          const double x = (c - (columns - 1) / 2.0) * pitch, y = (r - (rows - 1) / 2.0) * pitch;
          out.slots.push_back(
              at + Vec3(std::cos(turn) * x - std::sin(turn) * y, std::sin(turn) * x + std::cos(turn) * y, 0));
        }
      }
      POLYPOD_ASSIGN(tool_pitch, optional_angle(table, "pitch_deg", std::numbers::pi / 2));
      POLYPOD_ASSIGN(roll, optional_angle(table, "roll_deg", 0));
      if (table.has("heading_deg")) {
        POLYPOD_ASSIGN(heading, optional_angle(table, "heading_deg", 0));
        out.heading = heading;
      }
      POLYPOD_ASSIGN(clearance, optional_length(table, "clearance_mm", 0.1));
      POLYPOD_ASSIGN(containers, table.optional_integer("containers", 0, 0, static_cast<int>(out.slots.size())));
      POLYPOD_ASSIGN(filled, table.optional_integer("filled", 0, 0, cell_.containers[0].capacity));
      POLYPOD_ASSIGN(zone, table.optional_text("zone", ""));
      POLYPOD_ASSIGN(time, table.optional_number("time_s", out.kind == Spot::Kind::pour ? 2 : 0, kSeconds));
      if (out.kind == Spot::Kind::pour) {
        POLYPOD_TRY(needs_item(table));
        POLYPOD_ASSIGN(conveyor, index_of(cell_.conveyors, table, "conveyor", "conveyor"));
        POLYPOD_ASSIGN(along, span(table, "along_mm", units::kMetrePerMm, kMaybeSize_mm));
        POLYPOD_ASSIGN(across, span(table, "across_mm", units::kMetrePerMm, kPlace_mm));
        POLYPOD_TRY(ordered(table, "along_mm", along[0], along[1]));
        POLYPOD_TRY(ordered(table, "across_mm", across[0], across[1]));
        const Conveyor& c = cell_.conveyors[static_cast<std::size_t>(conveyor)];
        if (along[1] > c.length)
          return fail("CE105", fmt::format("{} is beyond the end of conveyor {}", out.name, c.name),
                      table.place_of("along_mm"));
        POLYPOD_TRY(on(c, table, "across_mm", across[0], across[1]));
        out.conveyor = conveyor;
        out.along_low = along[0];
        out.along_high = along[1];
        out.across_low = across[0];
        out.across_high = across[1];
      }
      POLYPOD_ASSIGN(size, optional_point(table, "size_mm", Vec3::Zero()));
      POLYPOD_ASSIGN(middle, optional_point(table, "body_at_mm", at));
      if ((size.array() < 0).any()) return fail("CE103", "a size is below 0", table.place_of("size_mm"));
      out.pitch = tool_pitch;
      out.roll = roll;
      out.clearance = clearance;
      out.containers = containers;
      out.filled = filled;
      out.zone = zone;
      out.time = time;
      out.size = size;
      out.middle = middle;
      out.turn = turn;
      POLYPOD_TRY(table.finish());
      cell_.spots.push_back(out);
    }
    return {};
  }

  Status machines(const std::string& file) {
    POLYPOD_ASSIGN(tables, some("machine"));
    for (const Table& table : tables) {
      Machine out;
      out.place = table.place();
      POLYPOD_TRY(fresh_name(table, out.name));
      POLYPOD_ASSIGN(model, table.text("file"));
      POLYPOD_ASSIGN(sets, table.optional_texts("set"));
      std::vector<machine::Override> overrides;
      for (const std::string& set : sets) {
        const std::size_t equals = set.find('=');
        if (equals == std::string::npos)
          return fail("CE108", fmt::format("set \"{}\": not key=value", one_line(set)), table.place_of("set"));
        overrides.push_back({set.substr(0, equals), set.substr(equals + 1)});
      }
      out.file = model;
      // A name with a suffix is a file beside the cell; others are those of the catalogue.
      const bool is_file = model.find('.') != std::string::npos || model.find('/') != std::string::npos;
      Result<machine::AnyMachine> loaded = machine::load(is_file ? config::beside(file, model) : model, overrides);
      if (!loaded) {
        Error error = loaded.error();
        if (error.place.file.empty()) error.place = table.place_of("file");
        return tl::unexpected(error);
      }
      out.model = std::move(*loaded);
      const int joints = kinematics::joint_count(out.model);
      const bool turns = kinematics::joint_kind(out.model, 0) == machine::JointKind::revolute;
      POLYPOD_ASSIGN(at, point(table, "at_mm"));
      std::vector<double> angles{0, 0, 0};
      if (table.has("angles_deg")) {
        POLYPOD_ASSIGN(a, table.numbers("angles_deg", 3, kAngle_deg));
        angles = a;
      }
      out.X_CM.p = at;
      out.X_CM.R = rotation_abc(units::from_deg(angles[0]), units::from_deg(angles[1]), units::from_deg(angles[2]));
      out.home = at;
      if (table.has("home_mm")) {
        POLYPOD_ASSIGN(home, point(table, "home_mm"));
        out.home = home;
      }
      const auto joint_values = [&](const std::string& key, double otherwise, Range range,
                                    bool mixed) -> Result<std::vector<double>> {
        std::vector<double> v;
        if (table.has(key)) {
          POLYPOD_ASSIGN(given, table.numbers(key, 0, range));
          v = given;
          if (v.size() == 1) v.assign(static_cast<std::size_t>(joints), v[0]);
          if (static_cast<int>(v.size()) != joints) {
            return fail("CF105", fmt::format("{} has {} numbers; {} has {} joints", key, v.size(), out.name, joints),
                        table.place_of(key));
          }
        } else {
          v.assign(static_cast<std::size_t>(joints), otherwise);
        }
        for (int j = 0; j < joints && mixed; ++j) {
          const bool angle = kinematics::joint_kind(out.model, j) == machine::JointKind::revolute;
          v[static_cast<std::size_t>(j)] =
              angle ? units::from_deg(v[static_cast<std::size_t>(j)]) : units::from_mm(v[static_cast<std::size_t>(j)]);
        }
        return v;
      };
      // Keys say deg where the first joint turns, else mm; joints of another kind count in mm or deg under the same
      // key.
      const std::string unit = turns ? "deg" : "mm";
      POLYPOD_ASSIGN(speed, joint_values("joint_speed_" + unit + "_per_s", 100, kSpeed, true));
      POLYPOD_ASSIGN(acceleration, joint_values("joint_acceleration_" + unit + "_per_s2", 500, kDerivative, true));
      out.joint_speed = speed;
      out.joint_acceleration = acceleration;
      if (table.has("home_joints_" + unit)) {
        POLYPOD_ASSIGN(home, joint_values("home_joints_" + unit, 0, {-1e6, 1e6}, true));
        out.home_joints = Eigen::Map<const Eigen::VectorXd>(home.data(), joints);
      }
      const auto number = [&](const std::string& key, double& to, double factor, Range range) -> Status {
        POLYPOD_ASSIGN(v, table.optional_number(key, to / factor, range));
        to = v * factor;
        return {};
      };
      constexpr double mm = units::kMetrePerMm;
      POLYPOD_TRY(number("tool_speed_mm_per_s", out.tool_speed, mm, kSpeed));
      POLYPOD_TRY(number("tool_acceleration_mm_per_s2", out.tool_acceleration, mm, kDerivative));
      POLYPOD_TRY(number("tool_jerk_mm_per_s3", out.tool_jerk, mm, kDerivative));
      const double drive = turns ? units::kRadPerDeg : mm;
      POLYPOD_TRY(number("drive_speed_" + unit + "_per_s", out.drive_speed, drive, kSpeed));
      POLYPOD_TRY(number("drive_acceleration_" + unit + "_per_s2", out.drive_acceleration, drive, kDerivative));
      POLYPOD_TRY(number("drive_jerk_" + unit + "_per_s3", out.drive_jerk, drive, kDerivative));
      POLYPOD_TRY(number("straight_speed_mm_per_s", out.straight_speed, mm, kSpeed));
      POLYPOD_TRY(number("lift_mm", out.lift, mm, kSize_mm));
      out.blend = std::min(out.blend, out.lift);
      POLYPOD_TRY(number("blend_mm", out.blend, mm, {0, units::to_mm(out.lift)}));
      POLYPOD_TRY(number("grip_s", out.grip, 1, kSeconds));
      POLYPOD_TRY(number("release_s", out.release, 1, kSeconds));
      POLYPOD_TRY(number("grip_failures", out.failure, 1, {0, 0.99}));
      POLYPOD_TRY(number("body_diameter_mm", out.body, mm, kMaybeSize_mm));
      POLYPOD_TRY(number("payload_kg", out.payload, 1, {0, 1e6}));
      POLYPOD_TRY(number("hand_mass_g", out.hand_mass, 1e-3, {0, 1e9}));
      if (table.has("stopping_ms")) {
        POLYPOD_ASSIGN(stopping, optional_ms(table, "stopping_ms", 0));
        out.stopping = stopping;
      }
      POLYPOD_TRY(table.finish());
      cell_.machines.push_back(std::move(out));
    }
    return {};
  }

  Status tasks() {
    POLYPOD_ASSIGN(tables, some("task"));
    for (const Table& table : tables) {
      Task out;
      out.place = table.place();
      POLYPOD_TRY(fresh_name(table, out.name));
      POLYPOD_ASSIGN(machine, index_of(cell_.machines, table, "machine", "machine"));
      POLYPOD_ASSIGN(from, table.text("from"));
      out.machine = machine;
      for (std::size_t c = 0; c < cell_.conveyors.size(); ++c)
        if (cell_.conveyors[c].name == from) out.from_conveyor = static_cast<int>(c);
      if (out.from_conveyor < 0) {
        POLYPOD_ASSIGN(spot, index_of(cell_.spots, table, "from", "conveyor or spot"));
        out.from = spot;
      }
      POLYPOD_ASSIGN(to, index_of(cell_.spots, table, "to", "spot"));
      out.to = to;
      const auto kind = [&](int spot) { return cell_.spots[static_cast<std::size_t>(spot)].kind; };
      if (out.from >= 0 && kind(out.from) == Spot::Kind::pour)
        return fail("CE106", "nothing stands where containers are emptied", table.place_of("from"),
                    "take from a pallet, a holder or an opening");
      if (kind(to) == Spot::Kind::pour)
        return fail("CE106", "a container cannot be left where it is emptied", table.place_of("to"),
                    "name the spot in `via`");
      if (table.has("via")) {
        POLYPOD_ASSIGN(via, index_of(cell_.spots, table, "via", "spot"));
        if (kind(via) != Spot::Kind::pour)
          return fail(
              "CE106",
              fmt::format("via {}: containers are not emptied there", cell_.spots[static_cast<std::size_t>(via)].name),
              table.place_of("via"), "name a spot of kind pour");
        out.via = via;
      }
      POLYPOD_ASSIGN(which, table.optional_text("which", "any"));
      if (which == "full")
        out.which = Task::Which::full;
      else if (which == "empty")
        out.which = Task::Which::empty;
      else if (which != "any")
        return fail("CE102", fmt::format("which \"{}\" is not known", one_line(which)), table.place_of("which"),
                    "any, full or empty");
      POLYPOD_ASSIGN(when, table.optional_texts("when"));
      if (!when.empty()) {
        out.working = out.ending = false;
        for (const std::string& state : when) {
          if (state == "work")
            out.working = true;
          else if (state == "end")
            out.ending = true;
          else
            return fail("CE102", fmt::format("when \"{}\" is not known", one_line(state)), table.place_of("when"),
                        "work or end");
        }
      }
      POLYPOD_ASSIGN(serve, table.optional_boolean("on_serve", false));
      POLYPOD_ASSIGN(keeps, table.optional_boolean("keeps_zone", false));
      POLYPOD_ASSIGN(step, table.optional_integer("step", 0, 0, 1000));
      out.on_serve = serve;
      out.keeps_zone = keeps;
      out.step = step;
      if (out.from_conveyor >= 0) {
        POLYPOD_TRY(needs_item(table));
        const Conveyor& c = cell_.conveyors[static_cast<std::size_t>(out.from_conveyor)];
        POLYPOD_ASSIGN(window, span(table, "window_mm", units::kMetrePerMm, kMaybeSize_mm));
        POLYPOD_TRY(ordered(table, "window_mm", window[0], window[1]));
        if (!(window[1] - window[0] > 1e-6) || window[1] > c.length) {
          return fail("CE105",
                      fmt::format("the window of task {} is not on conveyor {}, 0 to {:g} mm", out.name, c.name,
                                  units::to_mm(c.length)),
                      table.place_of("window_mm"));
        }
        for (const Camera& camera : cell_.cameras) {
          if (camera.conveyor != out.from_conveyor || camera.at - camera.field_along / 2 < window[1]) continue;
          return fail(
              "CE105",
              fmt::format("{} looks beyond the window of task {}: no item is known in time", camera.name, out.name),
              table.place_of("window_mm"), "belts run forward: the camera comes first");
        }
        if (c.sensor >= 0 && c.sensor > window[1]) {
          return fail("CE105",
                      fmt::format("the sensor of conveyor {} at {:g} mm is beyond the window: the belt would stand "
                                  "with an item out of reach",
                                  c.name, units::to_mm(c.sensor)),
                      table.place_of("window_mm"), "the sensor stands within the window");
        }
        POLYPOD_ASSIGN(release, optional_length(table, "release_mm",
                                                cell_.spots[static_cast<std::size_t>(to)].slots[0].z(), kPlace_mm));
        out.release = release;
        out.window_low = window[0];
        out.window_high = window[1];
        if (cell_.containers[0].diameter < cell_.items[0].diameter) {
          return fail("CE103",
                      fmt::format("{} of {:g} mm does not fit into {} of {:g} mm", cell_.items[0].name,
                                  units::to_mm(cell_.items[0].diameter), cell_.containers[0].name,
                                  units::to_mm(cell_.containers[0].diameter)),
                      table.place());
        }
      } else if (out.from == out.to && out.via < 0) {
        return fail("CE106",
                    fmt::format("task {} moves containers from {} to itself", out.name,
                                cell_.spots[static_cast<std::size_t>(to)].name),
                    table.place_of("to"));
      }
      POLYPOD_TRY(table.finish());
      cell_.tasks.push_back(out);
    }
    return {};
  }

  Status commands() {
    POLYPOD_ASSIGN(tables, some("command"));
    for (const Table& table : tables) {
      Command out;
      POLYPOD_ASSIGN(time, table.number("at_s", kSeconds));
      POLYPOD_ASSIGN(order, table.text("order"));
      out.time = time;
      if (order == "START")
        out.order = Order::start;
      else if (order == "STOP")
        out.order = Order::stop;
      else if (order == "SERVE")
        out.order = Order::serve;
      else if (order == "END")
        out.order = Order::end;
      else
        return fail("CE102", fmt::format("order \"{}\" is not known", one_line(order)), table.place_of("order"),
                    "START, STOP, SERVE or END");
      if (!cell_.commands.empty() && cell_.commands.back().time > time)
        return fail("CE105", "commands must stand in the order of their times", table.place_of("at_s"));
      POLYPOD_TRY(table.finish());
      cell_.commands.push_back(out);
    }
    return {};
  }

  Status bodies() {
    POLYPOD_ASSIGN(tables, some("body"));
    for (const Table& table : tables) {
      Body out;
      POLYPOD_TRY(fresh_name(table, out.name));
      POLYPOD_ASSIGN(kind, table.optional_text("kind", "body"));
      POLYPOD_ASSIGN(middle, point(table, "middle_mm"));
      POLYPOD_ASSIGN(size, table.numbers("size_mm", 3, kSize_mm));
      POLYPOD_ASSIGN(turn, optional_angle(table, "turn_deg", 0));
      POLYPOD_ASSIGN(module, table.optional_boolean("module", false));
      out.kind = kind;
      out.middle = middle;
      out.size = Vec3(size[0], size[1], size[2]) * units::kMetrePerMm;
      out.turn = turn;
      out.module = module;
      POLYPOD_TRY(table.finish());
      cell_.bodies.push_back(out);
    }
    return {};
  }

  Status guards() {
    POLYPOD_ASSIGN(tables, some("guard"));
    for (const Table& table : tables) {
      Guard out;
      out.place = table.place();
      POLYPOD_TRY(fresh_name(table, out.name));
      POLYPOD_ASSIGN(kind, table.text("kind"));
      if (kind == "fence")
        out.kind = Guard::Kind::fence;
      else if (kind == "curtain")
        out.kind = Guard::Kind::curtain;
      else if (kind == "scanner")
        out.kind = Guard::Kind::scanner;
      else
        return fail("CE102", fmt::format("kind \"{}\" is not known", one_line(kind)), table.place_of("kind"),
                    "fence, curtain or scanner");
      POLYPOD_ASSIGN(from, point(table, "from_mm"));
      POLYPOD_ASSIGN(to, point(table, "to_mm"));
      POLYPOD_ASSIGN(height, length(table, "height_mm"));
      POLYPOD_ASSIGN(resolution, optional_length(table, "resolution_mm", 0.030, {1, 500}));
      POLYPOD_ASSIGN(response, optional_ms(table, "response_ms", 0));
      POLYPOD_ASSIGN(opening, optional_length(table, "opening_mm", 0));
      POLYPOD_ASSIGN(shape, table.optional_text("opening_shape", "round"));
      POLYPOD_ASSIGN(opening_height, optional_length(table, "opening_height_mm", 0));
      POLYPOD_ASSIGN(measure, table.optional_text("measure", ""));
      if (shape != "round" && shape != "square" && shape != "slot")
        return fail("CE102", fmt::format("opening_shape \"{}\" is not known", one_line(shape)),
                    table.place_of("opening_shape"), "slot, square or round");
      if (!((to - from).norm() > 1e-6))
        return fail("CE105", fmt::format("guard {} has no length", out.name), table.place_of("to_mm"));
      out.from = from;
      out.to = to;
      out.height = height;
      out.resolution = resolution;
      out.response = response;
      out.opening = opening;
      out.opening_shape = shape;
      out.opening_height = opening_height;
      out.measure = measure;
      POLYPOD_TRY(table.finish());
      cell_.guards.push_back(out);
    }
    return {};
  }

  Status cost() {
    POLYPOD_ASSIGN(table, top_.optional_table("cost"));
    if (!table) return {};
    Cost& out = cell_.cost;
    POLYPOD_ASSIGN(currency, table->text("currency"));
    POLYPOD_ASSIGN(budget, table->optional_number("budget", 0, kMoney));
    POLYPOD_ASSIGN(hours, table->optional_number("assembly_hours", 0, {0, 1e6}));
    POLYPOD_ASSIGN(hour_price, table->optional_number("assembly_price_per_hour", 0, kMoney));
    POLYPOD_ASSIGN(running, table->optional_number("running_price_per_hour", 0, kMoney));
    POLYPOD_ASSIGN(rows, table->tables("part"));
    out.currency = one_line(currency);
    out.budget = budget;
    out.hours = hours;
    out.hour_price = hour_price;
    out.running_price = running;
    if (rows.size() > kMostParts) return fail("CE106", "more than 1000 parts", rows[kMostParts].place());
    for (const Table& row : rows) {
      CostRow r;
      POLYPOD_ASSIGN(name, row.text("name"));
      POLYPOD_ASSIGN(stock, row.optional_boolean("stock", false));
      POLYPOD_ASSIGN(quantity, row.optional_number("quantity", 1, {0, 1e9}));
      POLYPOD_ASSIGN(price, stock ? row.optional_number("price", 0, kMoney) : row.number("price", kMoney));
      POLYPOD_ASSIGN(unit, row.optional_text("unit", "pcs"));
      POLYPOD_ASSIGN(note, row.optional_text("note", ""));
      POLYPOD_ASSIGN(kind, row.optional_text("kind", stock ? "at hand" : "buy"));
      r.name = name;
      r.stock = stock;
      r.quantity = quantity;
      r.price = price;
      r.unit = unit;
      r.note = note;
      r.kind = kind;
      POLYPOD_TRY(row.finish());
      out.rows.push_back(r);
    }
    return table->finish();
  }

  Status planning() {
    POLYPOD_ASSIGN(stations, some("station"));
    for (const Table& table : stations) {
      Station out;
      POLYPOD_ASSIGN(name, table.text("name"));
      for (const Station& other : cell_.stations)
        if (other.name == name)
          return fail("CE101", fmt::format("the station \"{}\" stands twice", one_line(name)), table.place_of("name"));
      POLYPOD_ASSIGN(at, optional_point(table, "at_mm", Vec3::Zero()));
      POLYPOD_ASSIGN(fixed, table.optional_boolean("fixed", true));
      out.name = name;
      out.at = at;
      out.fixed = fixed;
      POLYPOD_TRY(table.finish());
      cell_.stations.push_back(out);
    }
    if (cell_.stations.empty()) {  // those of the cell
      for (const Conveyor& c : cell_.conveyors) cell_.stations.push_back({c.name, c.point(c.length / 2, 0), true});
      for (const Spot& s : cell_.spots) {
        Vec3 middle = Vec3::Zero();
        for (const Vec3& slot : s.slots) middle += slot / static_cast<double>(s.slots.size());
        cell_.stations.push_back({s.name, middle, true});
      }
      for (const Machine& m : cell_.machines) cell_.stations.push_back({m.name, m.X_CM.p, false});
    }
    POLYPOD_ASSIGN(flows, some("flow"));
    for (const Table& table : flows) {
      Flow out;
      POLYPOD_ASSIGN(from, index_of(cell_.stations, table, "from", "station"));
      POLYPOD_ASSIGN(to, index_of(cell_.stations, table, "to", "station"));
      POLYPOD_ASSIGN(amount, table.number("per_hour", {0, 1e9}));
      out.from = from;
      out.to = to;
      out.amount = amount;
      if (from == to) return fail("CE106", "a flow from a station to itself", table.place());
      POLYPOD_TRY(table.finish());
      cell_.flows.push_back(out);
    }
    POLYPOD_ASSIGN(relations, some("relation"));
    for (const Table& table : relations) {
      Relation out;
      POLYPOD_ASSIGN(a, index_of(cell_.stations, table, "a", "station"));
      POLYPOD_ASSIGN(b, index_of(cell_.stations, table, "b", "station"));
      POLYPOD_ASSIGN(closeness, table.text("closeness"));
      POLYPOD_ASSIGN(reason, table.optional_text("reason", ""));
      if (closeness.size() != 1 || std::string("AEIOUX").find(closeness) == std::string::npos) {
        return fail(
            "CE102", fmt::format("closeness \"{}\" is not known", one_line(closeness)), table.place_of("closeness"),
            "A absolutely necessary, E especially important, I important, O ordinary, U unimportant, X undesirable");
      }
      if (a == b) return fail("CE106", "a relation of a station to itself", table.place());
      out.a = a;
      out.b = b;
      out.closeness = closeness[0];
      out.reason = reason;
      POLYPOD_TRY(table.finish());
      cell_.relations.push_back(out);
    }
    return {};
  }

  /// What only the whole tells.
  Status together() {
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
  [[nodiscard]] bool reaches(int conveyor, double along, const Task& task) const {
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

  Table& top_;
  Cell cell_;
  std::set<std::string> names_;
  Table item_, container_;
};

/// `conveyor.A.speed_mm_per_s` with the name instead of a number in brackets.
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

Result<Cell> from_table(Table top, const std::string& file, const std::vector<Override>& overrides) {
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
