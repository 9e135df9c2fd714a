// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/statics/plane.hpp"

#include <algorithm>
#include <cmath>

#include "polypod/core/units.hpp"
#include "polypod/kinematics/parts.hpp"

namespace polypod::statics {
namespace {

/// The reached points of a grid of n x n over `in`, and one step more on each side.
std::optional<Rectangle> scan(Probe& probe, Plane plane, double at, const Rectangle& in, int n) {
  const PlaneGrid grid = plane_grid(plane, at, in, n, n);
  int first_column = n, last_column = -1, first_row = n, last_row = -1;
  Mat3 unused;
  for (int row = 0; row < n; ++row) {
    for (int column = 0; column < n; ++column) {
      if (!probe.at(grid.point(column, row), unused)) continue;
      first_column = std::min(first_column, column);
      last_column = std::max(last_column, column);
      first_row = std::min(first_row, row);
      last_row = std::max(last_row, row);
    }
  }
  if (last_column < 0) return std::nullopt;
  const double du = (in.u[1] - in.u[0]) / (n - 1), dv = (in.v[1] - in.v[0]) / (n - 1);
  return Rectangle{{in.u[0] + (first_column - 1) * du, in.u[0] + (last_column + 1) * du},
                   {in.v[0] + (first_row - 1) * dv, in.v[0] + (last_row + 1) * dv}};
}

/// Outwards to multiples of a power of ten of mm (or half of one), at least about 20 of them.
std::array<double, 2> rounded(const std::array<double, 2>& range) {
  const double low = units::to_mm(range[0]), high = units::to_mm(range[1]);
  const double power = std::pow(10, std::floor(std::log10((high - low) / 20)));
  const double step = (high - low) / (5 * power) >= 20 ? 5 * power : power;
  // + 0.0: no negative zero
  return {units::from_mm(std::floor(low / step) * step + 0.0), units::from_mm(std::ceil(high / step) * step + 0.0)};
}

}  // namespace

std::optional<Plane> plane_named(std::string_view name) {
  for (const Plane plane : {Plane::xy, Plane::xz, Plane::yz})
    if (name == name_of(plane)) return plane;
  return std::nullopt;
}

std::string_view name_of(Plane plane) {
  return plane == Plane::xy ? "xy" : plane == Plane::xz ? "xz" : "yz";
}

PlaneAxes axes_of(Plane plane) {
  return plane == Plane::xy ? PlaneAxes{0, 1, 2} : plane == Plane::xz ? PlaneAxes{0, 2, 1} : PlaneAxes{1, 2, 0};
}

PlaneGrid plane_grid(Plane plane, double at, const Rectangle& rectangle, int columns, int rows) {
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

std::optional<Rectangle> reached_rectangle(const AnyMachine& machine, Plane plane, double at, const Mat3& R_MT) {
  const machine::Reach box = kinematics::reach(machine);
  const PlaneAxes axes = axes_of(plane);
  if (!(box.low[axes.normal] <= at && at <= box.high[axes.normal])) return std::nullopt;
  const Rectangle all{{box.low[axes.u], box.high[axes.u]}, {box.low[axes.v], box.high[axes.v]}};
  Probe probe(machine, R_MT);
  std::optional<Rectangle> found = scan(probe, plane, at, all, 41);
  if (!found) found = scan(probe, plane, at, all, 81);
  if (!found) return std::nullopt;
  if (const auto finer = scan(probe, plane, at, *found, 41)) found = finer;
  return Rectangle{rounded(found->u), rounded(found->v)};
}

}  // namespace polypod::statics
