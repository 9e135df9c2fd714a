// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Boxes, cylinders and ellipsoids that a workspace certainly holds (SLAV Figures 2.19, 2.20).
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "polypod/workspace/volume.hpp"

namespace polypod::workspace {

enum class ShapeKind {
  box,        ///< axis-parallel
  cylinder,   ///< axis along z, half[0] = half[1] its radius
  ellipsoid,  ///< axes along x, y, z
};

/// A shape in M by its middle and half its extents, m.
struct Shape {
  ShapeKind kind = ShapeKind::box;
  Vec3 center = Vec3::Zero();
  Vec3 half = Vec3::Zero();

  [[nodiscard]] double volume() const;
  /// Whether an axis-parallel box lies wholly within, or has a point in common. Exact.
  [[nodiscard]] bool holds_box(const Vec3& box_center, const Vec3& box_half) const;
  [[nodiscard]] bool meets_box(const Vec3& box_center, const Vec3& box_half) const;
};

/// Whether the machine certainly reaches every point of the shape in all directions of the options. True is a proof;
/// false if some point is out of reach or `max_cells` boxes did not settle it. Errors as for volume(). Cost: 1 to 50
/// ms.
Result<bool> certainly_holds(const AnyMachine& machine, const Options& options, const Shape& shape,
                             std::int64_t max_cells = 20'000);

/// A pose that is out of reach, and why: the limits of the solution that breaks the fewest, or the inverse's reason.
struct Missed {
  Pose pose;
  std::string reason;
};
/// The first such pose of an axis-parallel box, if one of 5 x 5 x 5 points, the corners first, shows it in one of
/// sampled_orientations(). Cost: 125 inverses an orientation at most.
std::optional<Missed> missed_in(const AnyMachine& machine, const Options& options, const Shape& box);

/// A shape of the kind that is certainly inside and cannot be made larger by moving or stretching it by 1 %: a pattern
/// search over middle and extents, started from the middle of the workspace and from its widest inner cells, every step
/// proven. A local optimum; no claim is made that no larger one exists elsewhere. Errors: those of volume(), WS120 (the
/// workspace is empty). Deterministic. Cost: some hundred proofs, a second or a few.
Result<Shape> largest_inside(const AnyMachine& machine, const Options& options, ShapeKind kind);

/// "box", "cylinder", "ellipsoid". Error: WS121.
Result<ShapeKind> shape_kind(std::string_view name);
const char* name_of(ShapeKind kind);

}  // namespace polypod::workspace
