// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Surfaces and lines in space, seen from one side, as SVG.
#pragma once

#include <array>
#include <optional>
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
  std::string name = {};           ///< of the switch that hides it where the scene turns; empty: none
  /// Only where the scene turns, e.g. a stock that is cut: from the place `at` of the first frames on the point lies
  /// `by` along `along` from where it lies in `points`, until another entry says otherwise.
  struct Shifts {
    Point3 along;
    std::vector<double> at;  ///< rising
    std::vector<int> point;
    std::vector<double> by;
  } shifts = {};
};

struct Line3 {
  std::string name;  ///< in the legend once for all lines of the same name; empty: not in the legend
  std::vector<Point3> points;
  Colour colour = Colour::ink;
  double stroke = 1.5;  ///< px
  bool dots = false;    ///< dots at the points instead of a line through them
  // Only where the scene turns:
  bool moves = false;               ///< its points are those of Scene::frames
  std::vector<double> value = {};   ///< of each point, for the colours of Scene::ramp; empty: `colour`
  std::vector<int> tag = {};        ///< of each point: the line of a program that it belongs to
  std::vector<Point3> offset = {};  ///< of each point, for Scene::shift (drawn, too)
};

/// A row of pictures of the lines that move: over time, or over a coordinate. Only where the scene turns.
struct Frames {
  struct Column {
    std::string name, unit;
    std::vector<double> values;  ///< one a frame; not finite: none
  };
  std::string name = "time", unit = "s";
  bool plays = true;                        ///< over time
  std::vector<double> at;                   ///< rising, one a frame
  std::vector<std::vector<Point3>> points;  ///< a frame: the points of all lines that move, in the order of the lines
  std::vector<Column> columns;              ///< read out beside the slider
  std::vector<std::string> notes;           ///< what is wrong in each frame; empty: nothing
  int start = 0;                            ///< the frame that is shown first
  std::vector<std::string> texts = {};      ///< what goes on in each frame, e.g. a line of a program; empty: not told
};

/// Points of lines are moved by `at` times their offset; where the scene turns a slider sets the factor, up to `most`.
struct Shift {
  std::string name;  ///< "deflection enlarged"
  double at = 1, most = 1;
};

/// What the colours of lines with values mean. Only where the scene turns.
struct Ramp {
  std::string name, unit;
  double low = 0, high = 1;
  ColourMap map = ColourMap::sequential;
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
  // Only where the scene turns:
  std::vector<Frames> frames = {};
  std::optional<Shift> shift = {};
  std::optional<Ramp> ramp = {};

  std::string operator()(const Canvas& canvas) const;
};

/// The points of a line as they are drawn: moved by Scene::shift.
std::vector<Point3> shown_points(const Scene& scene, const Line3& line);

/// The box of axes round everything that a scene draws, with some air; `with_frames`: also round all frames.
struct Box3 {
  Point3 low, high;
  double longest = 0;  ///< side, before there was air
};
Box3 box_of(const Scene& scene, bool with_frames);

/// Of each kind of a scene: whether any mesh has it, and its colour in legends, `#rrggbb`.
struct SceneKinds {
  std::vector<char> occurs;
  std::vector<std::string> fill;
};
SceneKinds kinds_of(const Scene& scene);

/// What a page's script needs to turn the scene, as JSON that may stand in a page: points of meshes in 65534 steps a
/// side of the box, points of lines as 32-bit floats. Points that are not finite interrupt lines, and leave triangles
/// out.
std::string scene_data(const Scene& scene);

}  // namespace polypod::report
