// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "reader.hpp"

namespace polypod::cell {

Status Reader::bodies() {
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

Status Reader::guards() {
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
    const bool at_height = table.has("opening_height_mm");
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
    out.resolution_given = table.has("resolution_mm");
    out.response_given = table.has("response_ms");
    out.opening = opening;
    out.opening_shape = shape;
    if (at_height) out.opening_height = opening_height;
    out.measure = measure;
    POLYPOD_TRY(table.finish());
    cell_.guards.push_back(out);
  }
  return {};
}

Status Reader::cost() {
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

Status Reader::planning() {
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

}  // namespace polypod::cell
