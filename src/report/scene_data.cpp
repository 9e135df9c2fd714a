// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A scene as the data of the pages' script (viewer/src/data.ts).
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

#include "packed.hpp"
#include "polypod/report/scene.hpp"
#include "svg.hpp"

namespace polypod::report {
namespace {

/// Text as a JSON string that cannot end the script element it stands in.
std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      out += '\\';
      out += c;
    } else if (static_cast<unsigned char>(c) < 0x20 || c == '<' || c == '>' || c == '&') {
      out += fmt::format("\\u{:04x}", static_cast<unsigned>(c));
    } else {
      out += c;
    }
  }
  return out + '"';
}

std::string json_number(double value) {
  if (!std::isfinite(value)) return "null";
  return fmt::format("{}", value == 0 ? 0.0 : value);
}

/// A figure that is read: thirteen digits (1e-9 of a metre in mm).
std::string figure_text(double value) {
  return std::isfinite(value) ? fmt::format("{:.13g}", value == 0 ? 0.0 : value) : "null";
}

template <class Items, class Text>
std::string list(const Items& items, const Text& text) {
  std::string out = "[";
  for (const auto& item : items) {
    if (out.size() > 1) out += ',';
    out += text(item);
  }
  return out + ']';
}
std::string list(const Point3& p) {
  return fmt::format("[{},{},{}]", json_number(p.x), json_number(p.y), json_number(p.z));
}

std::string in_quotes(const Packed& packed) {
  return '"' + packed.text() + '"';
}

constexpr std::uint16_t kNone = 65535;
constexpr double kSteps = 65534;

std::uint16_t whole(double value, double low, double step) {
  if (!std::isfinite(value)) return kNone;
  return static_cast<std::uint16_t>(std::clamp(std::round((value - low) / step), 0.0, kSteps));
}

/// Points in steps of the box.
class Quantised {
 public:
  explicit Quantised(const Box3& box) : low_(box.low) {
    const auto step = [](double lo, double hi) { return std::max((hi - lo) / kSteps, 1e-300); };
    step_ = {step(box.low.x, box.high.x), step(box.low.y, box.high.y), step(box.low.z, box.high.z)};
  }
  void add(const Point3& p) {
    packed_.add(whole(p.x, low_.x, step_.x));
    packed_.add(whole(p.y, low_.y, step_.y));
    packed_.add(whole(p.z, low_.z, step_.z));
  }
  [[nodiscard]] std::string text() const {
    return fmt::format("{{\"low\":{},\"step\":{},\"data\":{}}}", list(low_), list(step_), in_quotes(packed_));
  }

 private:
  Point3 low_, step_;
  Packed packed_;
};

std::string floats(const std::vector<Point3>& points) {
  Packed packed;
  for (const Point3& p : points)
    for (const double x : {p.x, p.y, p.z}) packed.add(static_cast<float>(x));
  return in_quotes(packed);
}

std::string mesh_text(const Mesh& mesh, const Box3& box) {
  Quantised points(box);
  for (const Point3& p : mesh.points) points.add(p);
  Packed triangles;
  for (const auto& t : mesh.triangles) {
    const bool known = std::all_of(t.begin(), t.end(), [&](int v) {
      if (v < 0 || static_cast<std::size_t>(v) >= mesh.points.size()) return false;
      const Point3& p = mesh.points[static_cast<std::size_t>(v)];
      return std::isfinite(p.x + p.y + p.z);
    });
    for (const int v : t)
      if (known) triangles.add(static_cast<std::uint32_t>(v));
  }
  std::string out = fmt::format("{{\"name\":{},\"opacity\":{},\"points\":{},\"triangles\":{}", quoted(mesh.name),
                                json_number(mesh.opacity), points.text(), in_quotes(triangles));
  if (mesh.kind.size() == mesh.points.size() && !mesh.kind.empty()) {
    Packed kinds;
    for (const int kind : mesh.kind) kinds.add(static_cast<std::int8_t>(std::clamp(kind, -1, 127)));
    out += ",\"kind\":" + in_quotes(kinds);
  }
  if (mesh.value.size() == mesh.points.size() && !mesh.value.empty()) {
    double low = std::numeric_limits<double>::infinity(), high = -low;
    for (const double v : mesh.value) {
      if (!std::isfinite(v)) continue;
      low = std::min(low, v);
      high = std::max(high, v);
    }
    if (!(low <= high)) low = high = 0;
    const double step = std::max((high - low) / kSteps, 1e-300);
    Packed values;
    for (const double v : mesh.value) values.add(whole(v, low, step));
    out += fmt::format(",\"value\":{{\"low\":[{}],\"step\":[{}],\"data\":{}}}", json_number(low), json_number(step),
                       in_quotes(values));
  }
  const Mesh::Shifts& s = mesh.shifts;
  if (!s.at.empty() && s.point.size() == s.at.size() && s.by.size() == s.at.size()) {
    Packed at, point, by;
    for (std::size_t k = 0; k < s.at.size(); ++k) {
      at.add(static_cast<float>(s.at[k]));
      point.add(static_cast<std::uint32_t>(s.point[k]));
      by.add(static_cast<float>(s.by[k]));
    }
    out += fmt::format(",\"shifts\":{{\"along\":{},\"at\":{},\"point\":{},\"by\":{}}}", list(s.along), in_quotes(at),
                       in_quotes(point), in_quotes(by));
  }
  return out + '}';
}

std::string line_text(const Line3& line) {
  const std::string name = svg::class_of(line.colour);  // "c-blue"
  std::string out = fmt::format(
      "{{\"name\":{0},\"layer\":{0},\"colour\":\"{1}\",\"stroke\":{2},\"dots\":{3},\"moves\":{4},\"points\":{5}",
      quoted(line.name), name.substr(2), json_number(line.stroke), line.dots, line.moves, floats(line.points));
  if (line.value.size() == line.points.size() && !line.value.empty()) {
    Packed values;
    for (const double v : line.value) values.add(static_cast<float>(v));
    out += ",\"value\":" + in_quotes(values);
  }
  if (line.tag.size() == line.points.size() && !line.tag.empty()) {
    out += ",\"tag\":" + list(line.tag, [](int tag) { return fmt::format("{}", tag); });
  }
  return out + '}';
}

std::string frames_text(const Frames& frames, const Box3& box) {
  Quantised points(box);
  for (const auto& frame : frames.points)
    for (const Point3& p : frame) points.add(p);
  const std::string columns = list(frames.columns, [](const Frames::Column& c) {
    return fmt::format("{{\"name\":{},\"unit\":{},\"values\":{}}}", quoted(c.name), quoted(c.unit),
                       list(c.values, figure_text));
  });
  return fmt::format(
      "{{\"name\":{},\"unit\":{},\"plays\":{},\"at\":{},\"points\":{},\"columns\":{},\"notes\":{},\"start\":{}{}}}",
      quoted(frames.name), quoted(frames.unit), frames.plays, list(frames.at, figure_text), points.text(), columns,
      list(frames.notes, quoted), frames.start, frames.texts.empty() ? "" : ",\"texts\":" + list(frames.texts, quoted));
}

}  // namespace

std::string scene_data(const Scene& scene) {
  const Box3 box = box_of(scene, true);
  const SceneKinds kinds = kinds_of(scene);
  std::string kind_list = "[";
  for (std::size_t k = 0; k < scene.kinds.size(); ++k) {
    kind_list += fmt::format("{}{{\"name\":{},\"fill\":\"{}\",\"shown\":{}}}", k > 0 ? "," : "", quoted(scene.kinds[k]),
                             kinds.fill[k], kinds.occurs[k] != 0);
  }
  kind_list += ']';
  std::string out = fmt::format(
      "{{\"title\":{},\"unit\":{},\"axes\":{},\"view\":[{},{}],\"low\":{},\"high\":{},\"kinds\":{},\"none\":\"{}\","
      "\"levels\":{}",
      quoted(scene.title), quoted(scene.unit), list(scene.axes, quoted), json_number(scene.azimuth_deg),
      json_number(scene.elevation_deg), list(box.low), list(box.high), kind_list, kind_colour(-1, 0.66),
      list(scene.levels, json_number));
  out += ",\n\"meshes\":" + list(scene.meshes, [&](const Mesh& mesh) { return mesh_text(mesh, box); });
  out += ",\n\"lines\":" + list(scene.lines, line_text);
  out += ",\n\"frames\":" + list(scene.frames, [&](const Frames& frames) { return frames_text(frames, box); });
  if (scene.shift) {
    std::string lines, offsets;
    for (std::size_t k = 0; k < scene.lines.size(); ++k) {
      const Line3& line = scene.lines[k];
      if (line.offset.empty() || line.offset.size() != line.points.size()) continue;
      lines += fmt::format("{}{}", lines.empty() ? "" : ",", k);
      offsets += (offsets.empty() ? "" : ",") + floats(line.offset);
    }
    out += fmt::format(",\n\"shift\":{{\"name\":{},\"lines\":[{}],\"offsets\":[{}],\"most\":{},\"at\":{}}}",
                       quoted(scene.shift->name), lines, offsets, json_number(scene.shift->most),
                       json_number(scene.shift->at));
  }
  if (scene.ramp) {
    constexpr int kColours = 33;
    std::string map;
    for (int k = 0; k < kColours; ++k)
      map += fmt::format("{}\"{}\"", k > 0 ? "," : "", colour_at(scene.ramp->map, k / double(kColours - 1)));
    out += fmt::format(",\n\"colours\":{{\"name\":{},\"unit\":{},\"low\":{},\"high\":{},\"map\":[{}]}}",
                       quoted(scene.ramp->name), quoted(scene.ramp->unit), json_number(scene.ramp->low),
                       json_number(scene.ramp->high), map);
  }
  return out + '}';
}

}  // namespace polypod::report
