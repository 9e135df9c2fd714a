// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/motion/path.hpp"

#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "polypod/core/config.hpp"
#include "polypod/core/units.hpp"

namespace polypod::motion {
namespace {

/// Points nearer than this are one, m.
constexpr double kSame = 1e-9;

}  // namespace

Motion Segment::at(double s) const {
  Motion out;
  if (!(radius > 0)) {
    const Vec3 t = (to - from) / length;
    out.p = from + s * t;
    out.v = t;
    return out;
  }
  const double angle = s / radius, c = std::cos(angle), n = std::sin(angle);
  out.p = center + radius * (c * u + n * v);
  out.v = c * v - n * u;
  out.a = -(c * u + n * v) / radius;
  out.j = -out.v / (radius * radius);
  return out;
}

Motion Path::at(double s) const {
  for (const Segment& segment : segments) {
    if (s < segment.length || &segment == &segments.back()) return segment.at(std::min(s, segment.length));
    s -= segment.length;
  }
  return {};
}

std::vector<double> Path::corners() const {
  std::vector<double> out;
  for (std::size_t k = 0; k + 1 < segments.size(); ++k) {
    const Vec3 in = segments[k].at(segments[k].length).v, onward = segments[k + 1].at(0).v;
    out.push_back(std::atan2(in.cross(onward).norm(), in.dot(onward)));
  }
  return out;
}

Result<Segment> line(const Vec3& from, const Vec3& to) {
  Segment out;
  out.from = from;
  out.to = to;
  out.length = (to - from).norm();
  if (!(out.length > kSame) || !std::isfinite(out.length)) {
    return fail("MO100", fmt::format("a line from {:g}, {:g}, {:g} mm to itself has no length", units::to_mm(from.x()),
                                     units::to_mm(from.y()), units::to_mm(from.z())));
  }
  return out;
}

Result<Segment> arc(const Vec3& from, const Vec3& via, const Vec3& to) {
  const Vec3 a = via - from, b = to - from, n = a.cross(b);
  const double nn = n.squaredNorm();
  if (!(nn > 1e-12 * a.squaredNorm() * b.squaredNorm()) || !std::isfinite(nn)) {
    return fail("MO102", "the three points of an arc lie on a line", {}, "leave out via_mm for a line");
  }
  Segment out;
  out.from = from;
  out.to = to;
  out.center = from + (b.squaredNorm() * n.cross(a) - a.squaredNorm() * n.cross(b)) / (2 * nn);
  out.radius = (from - out.center).norm();
  out.u = (from - out.center) / out.radius;
  out.v = n.normalized().cross(out.u);  // from over via to `to` turns about n
  double angle = std::atan2((to - out.center).dot(out.v), (to - out.center).dot(out.u));
  if (angle <= 0) angle += 2 * std::numbers::pi;
  out.length = out.radius * angle;
  return out;
}

Result<Path> path_of(std::vector<Segment> segments) {
  if (segments.empty()) {
    return fail("MO100", "a path needs at least two different points", {}, "give where it starts and where it ends");
  }
  Path out;
  out.segments = std::move(segments);
  for (const Segment& segment : out.segments) out.length += segment.length;
  return out;
}

Result<Path> path_through(const std::vector<Vec3>& points) {
  std::vector<Segment> segments;
  for (std::size_t k = 0; k + 1 < points.size(); ++k) {
    POLYPOD_ASSIGN(segment, line(points[k], points[k + 1]));
    segments.push_back(segment);
  }
  return path_of(std::move(segments));
}

Result<PathFile> read_path(const std::string& file) {
  POLYPOD_ASSIGN(table, config::read_file(file));
  const auto point = [](const config::Table& in, const char* key) -> Result<Vec3> {
    POLYPOD_ASSIGN(values, in.numbers(key, 3));
    return Vec3(units::from_mm(values[0]), units::from_mm(values[1]), units::from_mm(values[2]));
  };
  POLYPOD_ASSIGN(at, point(table, "start_mm"));
  POLYPOD_ASSIGN(speed, table.optional_number("speed_mm_per_s", 0, config::kNotNegative));
  POLYPOD_ASSIGN(rows, table.tables("segments"));
  POLYPOD_TRY(table.finish());
  std::vector<Segment> segments;
  for (const config::Table& row : rows) {
    POLYPOD_ASSIGN(to, point(row, "to_mm"));
    Result<Segment> segment = line(at, to);
    if (row.has("via_mm")) {
      POLYPOD_ASSIGN(via, point(row, "via_mm"));
      segment = arc(at, via, to);
    }
    POLYPOD_TRY(row.finish());
    if (!segment) return fail(segment.error().id, segment.error().message, row.place(), segment.error().hint);
    segments.push_back(*segment);
    at = to;
  }
  POLYPOD_ASSIGN(path, path_of(std::move(segments)));
  return PathFile{std::move(path), units::from_mm(speed)};
}

}  // namespace polypod::motion
