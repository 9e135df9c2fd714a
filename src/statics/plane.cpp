// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/statics/plane.hpp"

#include <algorithm>
#include <cmath>

#include "polypod/core/units.hpp"
#include "polypod/kinematics/parts.hpp"

namespace polypod::statics {
namespace {

using machine::Coordinate;

/// The reached points of a grid of n x n over `in`, and one step more on each side. `reached(u, v)`: whether that point
/// is.
template <class Reached>
std::optional<Rectangle> scan(Reached&& reached, const Rectangle& in, int n) {
  const double du = (in.u[1] - in.u[0]) / (n - 1), dv = (in.v[1] - in.v[0]) / (n - 1);
  int first_column = n, last_column = -1, first_row = n, last_row = -1;
  for (int row = 0; row < n; ++row) {
    for (int column = 0; column < n; ++column) {
      if (!reached(coordinate_of(in.u, column, n), coordinate_of(in.v, row, n))) continue;
      first_column = std::min(first_column, column);
      last_column = std::max(last_column, column);
      first_row = std::min(first_row, row);
      last_row = std::max(last_row, row);
    }
  }
  if (last_column < 0) return std::nullopt;
  return Rectangle{{in.u[0] + (first_column - 1) * du, in.u[0] + (last_column + 1) * du},
                   {in.v[0] + (first_row - 1) * dv, in.v[0] + (last_row + 1) * dv}};
}

/// Outwards to multiples of a power of ten of mm or deg (or half of one), at least about 20 of them.
std::array<double, 2> rounded(const std::array<double, 2>& range, Coordinate of) {
  const double unit = is_angle(of) ? units::from_deg(1) : units::from_mm(1);
  const double low = range[0] / unit, high = range[1] / unit;
  const double power = std::pow(10, std::floor(std::log10((high - low) / 20)));
  const double step = (high - low) / (5 * power) >= 20 ? 5 * power : power;
  // + 0.0: no negative zero
  return {(std::floor(low / step) * step + 0.0) * unit, (std::ceil(high / step) * step + 0.0) * unit};
}

/// By two scans, a coarse one of `all` and a fine one of what that found.
template <class Reached>
std::optional<Rectangle> found_in(const Plane& plane, const Rectangle& all, Reached&& reached) {
  std::optional<Rectangle> found = scan(reached, all, 41);
  if (!found) found = scan(reached, all, 81);
  if (!found) return std::nullopt;
  if (const auto finer = scan(reached, *found, 41)) found = finer;
  return Rectangle{rounded(found->u, plane.u), rounded(found->v, plane.v)};
}

/// The pose that the task prescribes with the plane's coordinates at u and v.
Pose pose_over(const machine::Task& task, const TaskPlane& over, double u, double v) {
  std::vector<double> coordinates = over.coordinates;
  for (int i = 0; i < task.size(); ++i) {
    if (task[i] == over.plane.u) coordinates[static_cast<std::size_t>(i)] = u;
    if (task[i] == over.plane.v) coordinates[static_cast<std::size_t>(i)] = v;
  }
  return kinematics::pose_of(task, coordinates);
}

}  // namespace

std::optional<Plane> plane_named(std::string_view name) {
  constexpr std::string_view kLetters = "xyzABC";
  if (name.size() != 2) return std::nullopt;
  std::array<std::size_t, 2> found{};
  for (std::size_t i = 0; i < 2; ++i) {
    const char c = name[i];
    found[i] = kLetters.find(c);
    if (found[i] == kLetters.npos) found[i] = kLetters.find(static_cast<char>(c ^ 0x20));  // the other case
    if (found[i] == kLetters.npos) return std::nullopt;
  }
  if (found[0] >= found[1]) return std::nullopt;
  return Plane{static_cast<Coordinate>(found[0]), static_cast<Coordinate>(found[1])};
}

std::string name_of(const Plane& plane) {
  return std::string(machine::name_of(plane.u)) + machine::name_of(plane.v);
}

PlaneAxes axes_of(const Plane& plane) {
  const int u = static_cast<int>(plane.u), v = static_cast<int>(plane.v);
  return {u, v, 3 - u - v};
}

PlaneGrid plane_grid(const Plane& plane, double at, const Rectangle& rectangle, int columns, int rows) {
  const PlaneAxes axes = axes_of(plane);
  PlaneGrid grid;
  grid.origin[axes.u] = rectangle.u[0];
  grid.origin[axes.v] = rectangle.v[0];
  grid.origin[axes.normal] = at;
  grid.u = (rectangle.u[1] - rectangle.u[0]) * Vec3::Unit(axes.u);
  grid.v = (rectangle.v[1] - rectangle.v[0]) * Vec3::Unit(axes.v);
  grid.columns = columns;
  grid.rows = rows;
  return grid;
}

std::optional<Rectangle> reached_rectangle(const AnyMachine& machine, const Plane& plane, double at, const Mat3& R_MT) {
  const machine::Reach box = kinematics::reach(machine);
  const PlaneAxes axes = axes_of(plane);
  if (!(box.low[axes.normal] <= at && at <= box.high[axes.normal])) return std::nullopt;
  Probe probe(machine, R_MT);
  Vec3 p_M(at, at, at);
  Mat3 unused;
  const auto reached = [&](double u, double v) {
    p_M[axes.u] = u;
    p_M[axes.v] = v;
    return probe.at(p_M, unused);
  };
  return found_in(plane, {{box.low[axes.u], box.high[axes.u]}, {box.low[axes.v], box.high[axes.v]}}, reached);
}

std::vector<Plane> planes_of(const machine::Task& task) {
  std::vector<Plane> out;
  for (const int angles : {0, 2, 1}) {
    for (int u = 0; u < 6; ++u) {
      for (int v = u + 1; v < 6; ++v) {
        const Plane plane{static_cast<Coordinate>(u), static_cast<Coordinate>(v)};
        const bool held = task.holds(plane.u) && task.holds(plane.v);
        if (held && int{is_angle(plane.u)} + int{is_angle(plane.v)} == angles) out.push_back(plane);
      }
    }
  }
  return out;
}

std::vector<double> middle_coordinates(const AnyMachine& machine) {
  const machine::Task task = kinematics::task(machine);
  std::vector<double> out(static_cast<std::size_t>(task.size()), 0.0);
  for (int i = 0; i < task.size(); ++i)
    if (!task.is_angle(i))
      out[static_cast<std::size_t>(i)] = kinematics::middle_of_work(machine)[static_cast<int>(task[i])];
  return out;
}

std::optional<Rectangle> reached_rectangle(const AnyMachine& machine, const TaskPlane& over) {
  const machine::Reach box = kinematics::reach(machine);
  const machine::Task task = kinematics::task(machine);
  const auto all = [&](Coordinate c) -> std::array<double, 2> {
    if (!is_angle(c)) return {box.low[static_cast<int>(c)], box.high[static_cast<int>(c)]};
    const double most = c == Coordinate::c ? units::from_deg(180) : units::from_deg(45);
    return {-most, most};
  };
  return found_in(over.plane, {all(over.plane.u), all(over.plane.v)}, [&](double u, double v) {
    return kinematics::inverse(machine, pose_over(task, over, u, v)).reachable() != nullptr;
  });
}

Map compliance_map(const AnyMachine& machine, const TaskPlane& over, const Rectangle& rectangle, int columns,
                   int rows) {
  const machine::Task task = kinematics::task(machine);
  Map map;
  map.grid.columns = columns;
  map.grid.rows = rows;
  for (int row = 0; row < rows; ++row)
    for (int column = 0; column < columns; ++column)
      map.points.push_back(map_point(machine, pose_over(task, over, coordinate_of(rectangle.u, column, columns),
                                                        coordinate_of(rectangle.v, row, rows))));
  return map;
}

}  // namespace polypod::statics
