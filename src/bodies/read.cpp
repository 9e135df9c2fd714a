// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "../machine/machine_file.hpp"
#include "polypod/bodies/bodies.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/parts.hpp"

namespace polypod::bodies {
namespace {

// A body that reaches farther from the origin of its frame than this many times the machine's reach, or that is smaller
// than this part of it, has the wrong unit.
constexpr double kLargest = 10, kSmallest = 1e-4;
constexpr config::Range kSize_mm{0, 1e6, true, false};

Vec3 mm(const std::vector<double>& v) {
  return units::from_mm(1) * Vec3(v[0], v[1], v[2]);
}

Result<Shape> mesh_from(const config::Table& table, const std::string& path) {
  POLYPOD_ASSIGN(file, table.text("file"));
  POLYPOD_ASSIGN(unit, table.text("unit"));
  const double metres = unit == "mm"     ? units::from_mm(1)
                        : unit == "m"    ? 1.0
                        : unit == "inch" ? units::from_inch(1)
                                         : 0.0;
  if (metres == 0) {
    return fail("BO101", fmt::format("unit = \"{}\" must be \"mm\", \"m\" or \"inch\"", unit), table.place_of("unit"),
                "an STL file has no unit of its own");
  }
  auto mesh = read_stl(config::beside(path, file), metres);
  if (!mesh) {
    Error error = std::move(mesh.error());
    if (error.place.file.empty()) error.place = table.place_of("file");
    return tl::unexpected<Error>(std::move(error));
  }
  Shape s;
  s.mesh = *mesh;
  return s;
}

Result<Shape> shape_from(const config::Table& table, const std::string& path) {
  POLYPOD_ASSIGN(kind, table.text("shape"));
  if (kind == "mesh") return mesh_from(table, path);
  if (kind == "box") {
    POLYPOD_ASSIGN(min, table.numbers("min_mm", 3));
    POLYPOD_ASSIGN(max, table.numbers("max_mm", 3));
    if (!(mm(min).array() < mm(max).array()).all()) {
      return fail("BO102", fmt::format("{}: each of min_mm must be below that of max_mm", table.name()),
                  table.place_of("min_mm"));
    }
    return box(mm(min), mm(max));
  }
  if (kind != "capsule" && kind != "cylinder" && kind != "sphere") {
    return fail("BO103",
                fmt::format("shape = \"{}\" must be \"capsule\", \"cylinder\", \"sphere\", \"box\" or \"mesh\"", kind),
                table.place_of("shape"));
  }
  POLYPOD_ASSIGN(diameter, table.number("diameter_mm", kSize_mm));
  const double radius = 0.5 * units::from_mm(diameter);
  if (kind == "sphere") {
    POLYPOD_ASSIGN(centre, table.numbers("center_mm", 3));
    return Shape{{mm(centre)}, radius, 0, nullptr};
  }
  POLYPOD_ASSIGN(from, table.numbers("from_mm", 3));
  POLYPOD_ASSIGN(to, table.numbers("to_mm", 3));
  if (from == to && kind == "cylinder") {
    return fail("BO102", fmt::format("{}: from_mm and to_mm are the same point", table.name()),
                table.place_of("to_mm"));
  }
  return kind == "capsule" ? capsule(mm(from), mm(to), radius) : cylinder(mm(from), mm(to), radius);
}

Result<Body> body_from(const config::Table& table, const std::string& path, const machine::AnyMachine& machine) {
  Body body;
  POLYPOD_ASSIGN(name, table.text("name"));
  POLYPOD_ASSIGN(frame, table.text("frame"));
  body.name = one_line(name);
  if (frame == "machine") {
    body.frame = Body::Frame::machine;
  } else if (frame == "work") {
    body.frame = Body::Frame::work;
  } else if (frame == "tool") {
    body.frame = Body::Frame::tool;
  } else if (frame == "link") {
    body.frame = Body::Frame::link;
    if (!kinematics::is_serial(machine)) {
      return fail("BO104",
                  fmt::format("{}: {} is no serial arm, it has no links", table.name(), machine::name_of(machine)),
                  table.place_of("frame"), "give frame = \"machine\", \"work\" or \"tool\"");
    }
    POLYPOD_ASSIGN(link, table.integer("link", 0, static_cast<int>(std::get<machine::SerialArm>(machine).dh.size())));
    body.link = link;
  } else {
    return fail("BO103", fmt::format("frame = \"{}\" must be \"machine\", \"work\", \"link\" or \"tool\"", frame),
                table.place_of("frame"));
  }
  if (body.frame == Body::Frame::tool) {
    POLYPOD_ASSIGN(tool, table.optional_integer("tool", -1, 0, 100000));
    body.tool_number = tool;
  }
  if (body.frame == Body::Frame::work) {
    POLYPOD_ASSIGN(part, table.optional_boolean("is_cut", false));
    body.is_cut = part;
  }
  POLYPOD_ASSIGN(shape, shape_from(table, path));
  POLYPOD_ASSIGN(origin, machine::read_frame(table, "origin"));
  body.shape = placed(std::move(shape), origin);
  POLYPOD_TRY(table.finish());
  return body;
}

/// Whether its size can be, measured by the machine.
Status size_of(const Body& body, double reach, const Place& place) {
  const std::vector<Vec3>& points = body.shape.mesh ? body.shape.mesh->points : body.shape.points;
  const double size = body.shape.extent(points.front());
  const double from_origin = body.shape.extent(Vec3::Zero());
  if (body.frame == Body::Frame::tool && from_origin > reach) {
    return fail("BO106",
                fmt::format("{} reaches {:.0f} mm from the tool tip, more than the machine does ({:.0f} mm)", body.name,
                            units::to_mm(from_origin), units::to_mm(reach)),
                place, "z is 0 at the tip and counts towards the spindle, in mm");
  }
  if (from_origin <= kLargest * reach && size >= kSmallest * reach) return {};
  return fail("BO105",
              fmt::format("{} is {:.3g} mm large and reaches {:.3g} mm from the origin of its frame, beside a machine "
                          "that reaches {:.0f} mm: its unit cannot be right",
                          body.name, units::to_mm(size), units::to_mm(from_origin), units::to_mm(reach)),
              place, "lengths are in mm; for a mesh, say the unit of its file");
}

}  // namespace

Body cutter_body(double diameter, double length, int tool_number, double towards_spindle) {
  Body body;
  body.name = "cutter";
  body.frame = Body::Frame::tool;
  body.cuts = true;
  body.tool_number = tool_number;
  body.shape = cylinder(Vec3::Zero(), Vec3(0, 0, towards_spindle * length), 0.5 * diameter);
  return body;
}

Body stock_body(const Vec3& min, const Vec3& max) {
  Body body;
  body.name = "stock";
  body.frame = Body::Frame::work;
  body.is_cut = true;
  body.shape = box(min, max);
  return body;
}

Result<Bodies> read(const std::string& path, const machine::AnyMachine& machine) {
  POLYPOD_ASSIGN(table, config::read_file(path));
  const machine::Reach r = kinematics::reach(machine);
  const double reach = 0.5 * (r.high - r.low).maxCoeff();
  Bodies out;
  // z_T of a serial arm points to the spindle. That of a parallel machine points away from its platform, and where
  // the spindle is, its file does not say.
  POLYPOD_ASSIGN(spindle, table.optional_text("spindle", kinematics::is_serial(machine) ? "+z" : ""));
  if (spindle != "+z" && spindle != "-z") {
    return fail("BO108",
                fmt::format("spindle = \"{}\" must be \"+z\" or \"-z\": on which side of the tool tip, along z of the "
                            "tool, are cutter and holder?",
                            spindle),
                table.has("spindle") ? table.place_of("spindle") : table.place(),
                kinematics::is_serial(machine) ? "" : "a machine that is no serial arm needs it");
  }
  out.towards_spindle = spindle == "+z" ? 1 : -1;
  std::set<std::string> names{"cutter", "stock"};
  const auto add = [&](Body body, const Place& place) -> Status {
    POLYPOD_TRY(size_of(body, reach, place));
    names.insert(body.name);
    out.all.push_back(std::move(body));
    return {};
  };
  POLYPOD_ASSIGN(tables, table.tables("body"));
  for (const config::Table& one : tables) {
    POLYPOD_ASSIGN(body, body_from(one, path, machine));
    POLYPOD_TRY(add(std::move(body), one.place()));
  }
  POLYPOD_ASSIGN(holders, table.tables("holder"));
  for (const config::Table& one : holders) {
    Body body;
    POLYPOD_ASSIGN(name, one.optional_text("name", "holder"));
    POLYPOD_ASSIGN(diameter, one.number("diameter_mm", kSize_mm));
    POLYPOD_ASSIGN(from, one.number("from_mm", config::kNotNegative));
    POLYPOD_ASSIGN(to, one.number("to_mm", config::kPositive));
    POLYPOD_ASSIGN(tool, one.optional_integer("tool", -1, 0, 100000));
    POLYPOD_TRY(one.finish());
    if (!(from < to)) {
      return fail("BO102", fmt::format("{}: from_mm must be below to_mm", one.name()), one.place_of("from_mm"),
                  "both are above the tool tip, towards the spindle");
    }
    body.name = one_line(name);
    body.frame = Body::Frame::tool;
    body.tool_number = tool;
    const Vec3 up(0, 0, out.towards_spindle);
    body.shape = cylinder(units::from_mm(from) * up, units::from_mm(to) * up, 0.5 * units::from_mm(diameter));
    POLYPOD_TRY(add(std::move(body), one.place()));
  }
  if (out.all.empty()) {
    return fail("BO100", "no bodies: nothing could be judged", table.place(), "give [[body]] or [[holder]]");
  }
  POLYPOD_ASSIGN(ignore, table.optional_texts("ignore"));
  for (const std::string& text : ignore) {
    const auto plus = text.find(" + ");
    const std::string a = text.substr(0, plus), b = plus == std::string::npos ? "" : text.substr(plus + 3);
    for (const std::string& name : {a, b}) {
      if (names.contains(name)) continue;
      return fail("BO107", fmt::format("ignore: \"{}\": there is no body \"{}\"", text, name), table.place_of("ignore"),
                  "write two names of bodies with \" + \" between them");
    }
    out.ignored.emplace_back(a, b);
  }
  POLYPOD_TRY(table.finish());
  return out;
}

}  // namespace polypod::bodies
