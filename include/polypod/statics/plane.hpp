// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Planes parallel to those of M, and what a machine reaches of them: where maps are drawn.
#pragma once

#include <array>
#include <optional>
#include <string_view>

#include "polypod/statics/compliance.hpp"

namespace polypod::statics {

/// A plane parallel to two axes of M.
enum class Plane { xy, xz, yz };

/// "xy", "xz" or "yz"; nothing for any other text.
std::optional<Plane> plane_named(std::string_view name);
std::string_view name_of(Plane plane);

/// Axes of M by number (0, 1, 2 for x, y, z): two in the plane, in the order of its name, and the one across it.
struct PlaneAxes {
  int u = 0, v = 1, normal = 2;
};
PlaneAxes axes_of(Plane plane);

/// Ranges of the two coordinates of a plane, in M, m.
struct Rectangle {
  std::array<double, 2> u{0, 0}, v{0, 0};
};

/// The grid of columns x rows points over a rectangle of the plane whose third coordinate is `at` (m).
PlaneGrid plane_grid(Plane plane, double at, const Rectangle& rectangle, int columns, int rows);

/// A rectangle with round sides that holds what the tool tip reaches of the plane in the orientation R_MT with all
/// limits kept; nothing where it reaches no point of the plane. Found by two scans, a coarse one of all that the
/// lengths of the machine allow and a fine one of what that found: a region narrower than 1/80 of the machine's span
/// may be missed. Cost: about 10^4 inverse solutions.
std::optional<Rectangle> reached_rectangle(const AnyMachine& machine, Plane plane, double at, const Mat3& R_MT);

}  // namespace polypod::statics
