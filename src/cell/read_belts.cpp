// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <limits>

#include "reader.hpp"

namespace polypod::cell {

Status Reader::item() {
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

Status Reader::container() {
  POLYPOD_ASSIGN(table, top_.optional_table("container"));
  if (!table) return {};
  Container out;
  POLYPOD_TRY(fresh_name(*table, out.name));
  POLYPOD_ASSIGN(capacity, table->integer("capacity", 1, kMostItems));
  POLYPOD_ASSIGN(diameter, length(*table, "diameter_mm"));
  POLYPOD_ASSIGN(height, length(*table, "height_mm"));
  POLYPOD_ASSIGN(mass, table->optional_number("mass_g", 0, {0, 1e9}));
  POLYPOD_ASSIGN(grip, optional_length(*table, "grip_mm", height / 2));
  if (grip > height) {
    return fail("CE103", fmt::format("{} is taken above its top", out.name), table->place_of("grip_mm"),
                "grip_mm counts from its bottom, up to height_mm");
  }
  out.grip = grip;
  out.grip_given = table->has("grip_mm");
  out.capacity = capacity;
  out.diameter = diameter;
  out.height = height;
  out.mass = mass * 1e-3;
  container_ = *table;
  cell_.containers.push_back(out);
  return table->finish();
}

Status Reader::conveyors() {
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
    POLYPOD_ASSIGN(outfeed, table.optional_boolean("outfeed", false));
    if (outfeed && !next.empty()) {
      return fail("CE107", fmt::format("items of conveyor {} leave the cell and go onto {}", out.name, one_line(next)),
                  table.place_of("outfeed"), "leave out outfeed, or onto");
    }
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
    out.outfeed = outfeed;
    out.drop = drop;
    out.drop_spread = spread;
    out.sensor = sensor;
    POLYPOD_ASSIGN(acceleration, table.optional_number("acceleration_mm_per_s2", 0, {0, 1e12}));
    POLYPOD_ASSIGN(chute, table.optional_text("chute", ""));
    out.acceleration = units::from_mm(acceleration);
    out.chute = chute;
    out.drop_given = table.has("drop_mm");
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
    Conveyor& c = cell_.conveyors[i];
    if (c.onto.empty()) continue;
    POLYPOD_ASSIGN(next, index_of(cell_.conveyors, tables[i], "onto", "conveyor"));
    if (next == static_cast<int>(i)) {
      return fail("CE107", fmt::format("conveyor {} passes its items onto itself", c.name), tables[i].place_of("onto"),
                  "name another conveyor, or leave onto out");
    }
    const Conveyor& o = cell_.conveyors[static_cast<std::size_t>(next)];
    if (!c.drop_given) c.drop = c.flight(c.at.z() - o.at.z());
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

std::pair<double, double> Reader::on_belt(const Conveyor& c, const Vec3& p) {
  const Vec3 d = p - c.at;
  const double cs = std::cos(c.heading), sn = std::sin(c.heading);
  return {cs * d.x() + sn * d.y(), -sn * d.x() + cs * d.y()};
}

Status Reader::cameras() {
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
                  fmt::format("{} does not see a whole {}: its field is {:g} x {:g} mm", out.name, cell_.items[0].name,
                              units::to_mm(field[0]), units::to_mm(field[1])),
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

Status Reader::sources() {
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
      out.rate = units::from_per_min(rate);
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
    constexpr int kNoLimit = std::numeric_limits<int>::max();  // beyond any run
    POLYPOD_ASSIGN(limit, table.optional_integer("limit", kNoLimit, 1, kNoLimit));
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

Status Reader::needs_item(const Table& table) {
  if (!cell_.items.empty()) return {};
  return fail("CE106", "the cell has no [item]", table.place(),
              "add a table [item] with name, diameter_mm and height_mm");
}

Status Reader::on(const Conveyor& c, const Table& table, std::string_view key, double low, double high) {
  const double room = c.width / 2 - cell_.items[0].diameter / 2;
  if (low >= -room - 1e-12 && high <= room + 1e-12) return {};
  return fail(
      "CE103",
      fmt::format("{} of {:g} mm from {:g} to {:g} mm from the middle hang over the belt of conveyor {}, {:g} mm wide",
                  cell_.items[0].name, units::to_mm(cell_.items[0].diameter), units::to_mm(low), units::to_mm(high),
                  c.name, units::to_mm(c.width)),
      table.has(key) ? table.place_of(key) : table.place(), "take a wider belt, or places nearer to its middle");
}

}  // namespace polypod::cell
