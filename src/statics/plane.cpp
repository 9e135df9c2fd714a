// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/statics/plane.hpp"

#include <algorithm>
#include <cmath>
#include <concepts>
#include <limits>

#include "polypod/core/units.hpp"

namespace polypod::statics {
namespace {

/// A box in M that holds every point that the tool tip could reach by the lengths of the machine alone.
struct Box {
  Vec3 low, high;
};

Box span_of(const machine::SerialArm& arm) {
  double reach = arm.X_FT.p.norm();
  for (const machine::DhRow& row : arm.dh) {
    reach += std::abs(row.a) + std::abs(row.d);
    if (row.kind != machine::JointKind::prismatic) continue;
    const auto [low, high] = row.locked ? machine::JointRange{*row.locked, *row.locked} : row.range;
    reach += std::max(std::abs(low), std::abs(high));
  }
  return {arm.X_MB.p - Vec3::Constant(reach), arm.X_MB.p + Vec3::Constant(reach)};
}

/// Round the feet of the legs: a leg, then the way from its joint on the platform to the tip.
Box span_of(const machine::SixPoints& feet, const machine::SixPoints& platform, double tool, double leg) {
  double lever = 0;
  Box box{feet[0], feet[0]};
  for (int i = 0; i < machine::kLegs; ++i) {
    lever = std::max(lever, platform[i].norm() + std::abs(tool));
    box.low = box.low.cwiseMin(feet[i]);
    box.high = box.high.cwiseMax(feet[i]);
  }
  return {box.low - Vec3::Constant(leg + lever), box.high + Vec3::Constant(leg + lever)};
}
Box span_of(const machine::StrutHexapod& m) {
  return span_of(m.base_joint, m.platform_joint, m.tool_length, m.length_max);
}
Box span_of(const machine::SliderHexapod& m) {
  const Box a = span_of(m.rail_outer, m.platform_joint, m.tool_length, m.longest_leg());
  const Box b = span_of(m.rail_inner, m.platform_joint, m.tool_length, m.longest_leg());
  return {a.low.cwiseMin(b.low), a.high.cwiseMax(b.high)};
}

/// Round home: no chain reaches farther than arm (or rail) and rod.
template <class M>
requires std::derived_from<M, machine::Delta> Box span_of(const M& m) {
  double reach = 0;
  for (int i = 0; i < m.arms; ++i) {
    double chain = 2 * m.rod_length[i];
    if constexpr (std::is_same_v<M, machine::RotaryDelta>) {
      chain += 2 * m.arm_length[i];
    } else {
      chain += m.range.max;
    }
    reach = std::max(reach, chain);
  }
  return {m.home - Vec3::Constant(reach), m.home + Vec3::Constant(reach)};
}

/// Round what the legs are fixed to: the way of the drive, the leg, and from its end to the tip.
Box span_of(const machine::Parallel& m) {
  Box box{Vec3::Constant(std::numeric_limits<double>::infinity()),
          Vec3::Constant(-std::numeric_limits<double>::infinity())};
  for (const machine::ParallelLeg& leg : m.legs) {
    const double lever =
        leg.ring ? (leg.ring->center - m.tool).norm() + leg.ring->radius : (leg.platform - m.tool).norm();
    const double leg_length = leg.drive == machine::LegDrive::strut ? leg.range.max : leg.rod + leg.arm;
    std::array<Vec3, 2> ends{leg.base, leg.base};
    if (leg.drive == machine::LegDrive::rail) {
      ends = {leg.base + leg.range.min * leg.rail, leg.base + leg.range.max * leg.rail};
    }
    for (const Vec3& end : ends) {
      box.low = box.low.cwiseMin(end - Vec3::Constant(leg_length + lever));
      box.high = box.high.cwiseMax(end + Vec3::Constant(leg_length + lever));
    }
  }
  return box;
}

Vec3 middle_of(const machine::Parallel& m) {
  return m.home.p;
}
Vec3 middle_of(const machine::SerialArm&) {
  return Vec3::Zero();
}
Vec3 middle_of(const machine::Delta& m) {
  return m.home;
}
template <class Hexapod>
requires(!std::derived_from<Hexapod, machine::Delta>) Vec3 middle_of(const Hexapod& m) {
  return {0, 0, m.home.height + m.tool_length};
}

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

Vec3 middle_of_work(const AnyMachine& machine) {
  return std::visit([](const auto& m) { return middle_of(m); }, machine);
}

std::optional<Rectangle> reached_rectangle(const AnyMachine& machine, Plane plane, double at, const Mat3& R_MT) {
  const Box box = std::visit([](const auto& m) { return span_of(m); }, machine);
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
