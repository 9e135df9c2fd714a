// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Paths of lines and arcs by their length.
#pragma once

#include <string>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/geometry/pose.hpp"

namespace polypod::motion {

/// A point that moves, and its first three derivatives against time (or against length).
struct Motion {
  Vec3 p = Vec3::Zero(), v = Vec3::Zero(), a = Vec3::Zero(), j = Vec3::Zero();
};

/// A line, or an arc of a circle about `center` in the plane of two unit vectors: center + radius (cos u + sin v).
struct Segment {
  Vec3 from = Vec3::Zero(), to = Vec3::Zero();
  double length = 0;  ///< m
  double radius = 0;  ///< m, 0: a line
  Vec3 center = Vec3::Zero(), u = Vec3::UnitX(), v = Vec3::UnitY();

  /// The point at s of the length, with its derivatives against s.
  [[nodiscard]] Motion at(double s) const;
};

/// Segments that follow each other.
struct Path {
  std::vector<Segment> segments;
  double length = 0;

  /// Derivatives against s are those of the segment that begins at s where two meet.
  [[nodiscard]] Motion at(double s) const;
  /// Angles between the directions where segments meet, rad: one less than segments.
  [[nodiscard]] std::vector<double> corners() const;
};

/// A line; an arc from `from` over `via` to `to`. Errors: MO100 (no length), MO102 (the three points of an arc lie on a
/// line).
Result<Segment> line(const Vec3& from, const Vec3& to);
Result<Segment> arc(const Vec3& from, const Vec3& via, const Vec3& to);
/// Error: MO100 where there are no segments.
Result<Path> path_of(std::vector<Segment> segments);
/// Lines from point to point. Error: MO100 (fewer than two points, or two equal ones in a row).
Result<Path> path_through(const std::vector<Vec3>& points);

struct PathFile {
  Path path;
  double speed = 0;  ///< m/s, 0 where the file gives none
};
/// Reads `start_mm`, `speed_mm_per_s` (optional) and `segments = [{ to_mm, via_mm }]`; `via_mm` makes an arc. Errors:
/// the above, FI100 and those of config.
Result<PathFile> read_path(const std::string& file);

}  // namespace polypod::motion
