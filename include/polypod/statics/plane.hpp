// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Over what maps are drawn, and what a machine reaches of it: planes parallel to those of M, and two coordinates of a
// task of which one or both are angles.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/statics/compliance.hpp"

namespace polypod::statics {

/// Two coordinates of the tool, the first across the picture: two axes of M, to which the plane is parallel, or two
/// coordinates of a machine's task, one or both of them angles.
struct Plane {
  machine::Coordinate u = machine::Coordinate::x, v = machine::Coordinate::y;

  static const Plane xy;  ///< of M
  static const Plane xz;  ///< of M
  static const Plane yz;  ///< of M
  /// Whether it lies in the space of positions.
  [[nodiscard]] constexpr bool of_positions() const {
    return u <= machine::Coordinate::z && v <= machine::Coordinate::z;
  }
  friend constexpr bool operator==(const Plane& a, const Plane& b) { return a.u == b.u && a.v == b.v; }
  friend constexpr bool operator!=(const Plane& a, const Plane& b) { return !(a == b); }
};
/// @cond
inline constexpr Plane Plane::xy{machine::Coordinate::x, machine::Coordinate::y};
inline constexpr Plane Plane::xz{machine::Coordinate::x, machine::Coordinate::z};
inline constexpr Plane Plane::yz{machine::Coordinate::y, machine::Coordinate::z};
/// @endcond

/// "xy", "zA" or "AB": two of x, y, z, A, B, C in this order, in small or capital letters; nothing for any other text.
std::optional<Plane> plane_named(std::string_view name);
std::string name_of(const Plane& plane);

/// Axes of M by number (0, 1, 2 for x, y, z): two in the plane, in the order of its name, and the one across it.
struct PlaneAxes {
  int u = 0, v = 1, normal = 2;
};
/// Of a plane of positions.
PlaneAxes axes_of(const Plane& plane);

constexpr bool is_angle(machine::Coordinate c) {
  return c >= machine::Coordinate::a;
}

/// Coordinate i of n that lie evenly over a range, its ends among them.
inline double coordinate_of(const std::array<double, 2>& range, int i, int n) {
  return range[0] + (range[1] - range[0]) * (n > 1 ? double(i) / (n - 1) : 0.0);
}

/// Ranges of the two coordinates of a plane, m or rad.
struct Rectangle {
  std::array<double, 2> u{0, 0}, v{0, 0};
};

/// The grid of columns x rows points over a rectangle of the plane whose third coordinate is `at` (m).
PlaneGrid plane_grid(const Plane& plane, double at, const Rectangle& rectangle, int columns, int rows);

/// A rectangle with round sides that holds what the tool tip reaches of the plane in the orientation R_MT with all
/// limits kept; nothing where it reaches no point of the plane. Found by two scans, a coarse one of all that the
/// lengths of the machine allow and a fine one of what that found: a region narrower than 1/80 of the machine's span
/// may be missed. Cost: about 10^4 inverse solutions.
std::optional<Rectangle> reached_rectangle(const AnyMachine& machine, const Plane& plane, double at, const Mat3& R_MT);

/// Two coordinates of a machine's task over which a map goes, and where the others stand.
struct TaskPlane {
  Plane plane;                      ///< both are held by the task
  std::vector<double> coordinates;  ///< of the task in its order, m and rad; those of the plane do not count
};

/// Every two coordinates of the task over which a map can go, the usual ones first: two axes of M, two angles, one of
/// each. Empty where the task holds one alone.
std::vector<Plane> planes_of(const machine::Task& task);

/// Where a map stands if nothing else is said: the middle of the work, every angle 0.
std::vector<double> middle_coordinates(const AnyMachine& machine);

/// The compliances, shares and det J at columns x rows points over a rectangle of the two coordinates; points[i].p_M is
/// the tool tip as the machine settles there, the one that the coordinates prescribe where it is out of reach.
Map compliance_map(const AnyMachine& machine, const TaskPlane& over, const Rectangle& rectangle, int columns, int rows);

/// As above, over the two coordinates: angles are looked for within +-45 deg (C within +-180 deg).
std::optional<Rectangle> reached_rectangle(const AnyMachine& machine, const TaskPlane& over);

}  // namespace polypod::statics
