// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Surfaces and lines in space, seen from one side, as SVG.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "polypod/report/plot.hpp"

namespace polypod::report {

struct Point3 {
  double x = 0, y = 0, z = 0;
};

/// Triangles over points, counterclockwise seen from outside. What is seen from behind is drawn too, darker.
struct Mesh {
  std::vector<Point3> points;
  std::vector<std::array<int, 3>> triangles;  ///< those with an index beyond the points are left out
  std::vector<int> kind;                      ///< of each point, into Scene::kinds; empty: kind 0
  double opacity = 1;
  std::vector<double> value = {};  ///< of each point, for Scene::levels
};

struct Line3 {
  std::string name;  ///< in the legend once for all lines of the same name; empty: not in the legend
  std::vector<Point3> points;
  Colour colour = Colour::ink;
  double stroke = 1.5;  ///< px
  bool dots = false;    ///< dots at the points instead of a line through them
};

/// A parallel projection with a box of axes: shaded triangles (Lambert, normals averaged at the points) and lines,
/// drawn from the farthest to the nearest; what is nearer hides what is farther but where triangles cut each other.
/// Cost: n log n in the triangles; a picture of 5000 triangles has 0.2 MB.
struct Scene {
  std::string title;
  std::string unit = "mm";
  std::array<std::string, 3> axes{"x", "y", "z"};
  std::vector<Mesh> meshes;
  std::vector<std::string> kinds;  ///< names of the colours of the meshes, for the legend (those that occur)
  /// Rising. Meshes with values have bands of colour, along ColourMap::sequential, between these; triangles are cut
  /// where the value, linear over them, passes a level. `kinds` then names the bands, one more than levels.
  std::vector<double> levels;
  std::vector<Line3> lines;
  double azimuth_deg = -58;   ///< where the eye stands, about z from x
  double elevation_deg = 24;  ///< and above the plane of x and y, -90 to 90
  double max_aspect = 0.8;    ///< height over width is at most this

  std::string operator()(const Canvas& canvas) const;
};

}  // namespace polypod::report
