// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The boundary of a workspace as a closed surface of triangles.
#pragma once

#include <array>
#include <functional>
#include <vector>

#include "polypod/workspace/field.hpp"

namespace polypod::workspace {

/// A closed surface: every edge lies in exactly two triangles, which run through it in opposite directions; seen from
/// outside the corners of a triangle run counterclockwise; no two points coincide.
struct Surface {
  std::vector<Vec3> points;  ///< in M, m
  std::vector<std::array<int, 3>> triangles;
  std::vector<int> limit;  ///< at each point, the limit that makes the boundary there (as Field::limit)

  /// By the divergence theorem, 1/6 sum p0 . (p1 x p2), m^3.
  [[nodiscard]] double volume() const;
  [[nodiscard]] double area() const;  ///< m^2
};

struct SurfaceOptions {
  /// Points of the grid along the longest side, 8 to 512. The surface differs from the boundary by the square of the
  /// spacing over the radius of curvature, and where two limits meet in an edge it cuts that edge off within a spacing.
  int resolution = 64;
  int azimuths = 24;                     ///< as FieldOptions::azimuths
  std::function<void(double)> progress;  ///< share of the work
};

/// The boundary of the workspace that volume() measures, by marching tetrahedra (six to a cube of the grid, so that no
/// case is ambiguous and the surface is closed wherever the grid's own boundary lies outside) and then by collapsing
/// short edges, which leaves every remaining point where it was: on the true boundary, a root of the margin on an edge
/// of the grid to 1e-6 of it, but at least 1e-3 of the edge away from its ends. The same bytes for any number of
/// threads. Errors: those of field(), WS131 (nothing is reachable, or the grid is too coarse to meet it). Cost: 15 us a
/// point of the grid and 0.1 ms a point of the surface at a tilt; 64 points: some seconds.
Result<Surface> surface(const AnyMachine& machine, const Options& options, const SurfaceOptions& surface_options = {});

/// A part of the workspace.
struct Part {
  std::vector<char> inside;  ///< which points of the grid belong to it, of those in the workspace
  /// Where between a point of it and a neighbour that is in the workspace and not in the part its boundary runs, 0 to
  /// 1. Called from several threads.
  std::function<double(std::size_t in, std::size_t beyond)> share;
};

/// The same on a field that is there already (its margin; made with the same machine and options), of the whole
/// workspace or a part of it. The grid must be parallel to M's axes or any other right-handed one.
Result<Surface> surface_of(const AnyMachine& machine, const Options& options, const Field& field,
                           const SurfaceOptions& surface_options = {}, const Part* part = nullptr);

}  // namespace polypod::workspace
