// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Workspaces as fields over regular grids: how far inside, how far the tool may tilt, and which limit stops it.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "polypod/workspace/volume.hpp"

namespace polypod::workspace {

/// The index of a limit that is none of the machine's `limits`: the pose has no inverse solution at all.
inline constexpr int kOutOfReach = 64;
/// Nearer to a singular pose than Options::singular_distance.
inline constexpr int kNearSingular = 65;
/// An angle of a task without x, y, z is farther from home than these workspaces go (kFromHome).
inline constexpr int kFarFromHome = 66;

/// Points origin + i step[0] + j step[1] + k step[2] in M, m, or in the coordinates of a task without x, y, z, m and
/// rad; i fastest.
struct Grid {
  Vec3 origin = Vec3::Zero();
  std::array<Vec3, 3> step{Vec3::UnitX(), Vec3::UnitY(), Vec3::UnitZ()};
  std::array<int, 3> points{1, 1, 1};

  [[nodiscard]] std::size_t size() const {
    return static_cast<std::size_t>(points[0]) * static_cast<std::size_t>(points[1]) *
           static_cast<std::size_t>(points[2]);
  }
  [[nodiscard]] std::size_t index(int i, int j, int k) const {
    return (static_cast<std::size_t>(k) * static_cast<std::size_t>(points[1]) + static_cast<std::size_t>(j)) *
               static_cast<std::size_t>(points[0]) +
           static_cast<std::size_t>(i);
  }
  [[nodiscard]] Vec3 at(int i, int j, int k) const { return origin + i * step[0] + j * step[1] + k * step[2]; }
  [[nodiscard]] Vec3 at(std::size_t index) const;
};

/// The spacing of a grid over a box of this size: cubes, `resolution` points along its longest side; of a task without
/// x, y, z, whose points are of lengths and angles, as many along each side (and 1 along what is no coordinate).
Vec3 spacing_of(const Vec3& size, int resolution, const machine::Task& task);

/// A grid over the box low..high of the points of a task (task_directions.hpp), `resolution` 8 to 512, and one or two
/// rows of points beyond each side, so that a workspace inside the box does not touch the boundary of the grid. Errors:
/// WS130.
Result<Grid> grid_over(const Vec3& low, const Vec3& high, int resolution,
                       const machine::Task& task = machine::Task::pose);

/// A plane through the box low..high.
struct Plane {
  Vec3 point = Vec3::Zero();    ///< in M, m
  Vec3 normal = Vec3::UnitZ();  ///< in M, any length but 0
};
/// Squares on the plane where it cuts the box, likewise. step[0] and step[1] are M's axes if the plane is parallel to
/// two of them (y and z, x and z, x and y), otherwise step[0] is horizontal. Of a task without x, y, z the plane is one
/// of two of its coordinates, first, second and third in place of x, y, z, and the squares are rectangles. Errors:
/// WS130, WS132 (no normal, a slanting one of coordinates, or the plane misses the box).
Result<Grid> grid_on(const Plane& plane, const Vec3& low, const Vec3& high, int resolution,
                     const machine::Task& task = machine::Task::pose);

struct FieldOptions {
  /// Directions that are tried on each circle of tilts, 6 to 360. Between them a parabola finds the least margin of
  /// each limit, so that 24 are good to about 1e-4 of the range that a limit runs through over the circle.
  int azimuths = 24;
  /// Fills Field::tilt, tilt_limit and upright of machines whose task holds x, y, z, A and B, which takes most of the
  /// time.
  bool tilt = true;
  double tilt_max = 1.5;                 ///< rad; the search ends there. Above 0, below pi/2.
  std::function<void(double)> progress;  ///< share of the work, from the calling thread
};

struct Field {
  Grid grid;
  /// The least of all checked limits over all required directions: >= 0 inside. In m: lengths as they are, cosines of
  /// joint limits times the mean length of a leg, angles of an arm times the sum of its lengths; so the zero is exact
  /// and the slope of each limit of the order of one. Continuous but where a slider changes its root, or an arm its
  /// branch.
  std::vector<double> margin;
  std::vector<int> limit;  ///< which limit has it: a bit of kinematics::limit_name, or kOutOfReach
  /// The largest tilt up to which the tool may tilt from z at every azimuth, rad; -1 where not even R = 1 is reachable.
  std::vector<double> tilt;
  std::vector<int> tilt_limit;  ///< the limit that stops it; -1 if none does up to tilt_max
  std::vector<double> upright;  ///< the margin over R = 1 alone; 0 where `tilt` begins
};

/// Samples limits over a grid. Directions are sampled (with refinement between the samples): a picture, not a proof;
/// volume() has the proof. Of `options` the directions, interference, limits, threads and cancelled count. The same
/// numbers for any number of threads.
/// Errors: WS100, WS102, WS110, WS130 (a grid without points or beyond 2e8, azimuths or tilt_max out of range), WS133
/// (the grid takes more than Options::max_memory). Cost a point: 15 us for the margin at a tilt, 0.1 ms for the largest
/// tilt.
Result<Field> field(const AnyMachine& machine, const Options& options, const Grid& grid,
                    const FieldOptions& field_options = {});

/// The name of a limit as a person reads it: kinematics::limit_name, or "out of reach".
std::string limit_label(const AnyMachine& machine, int limit);
/// The same without the number of the leg for machines of equal legs: "strut above its maximum length".
std::string limit_kind(const AnyMachine& machine, int limit);

/// A box in M, m; empty where low > high.
struct Extent {
  Vec3 low = Vec3::Ones(), high = -Vec3::Ones();
  [[nodiscard]] bool empty() const { return (high.array() < low.array()).any(); }
};
/// A box that certainly holds what is reachable from all required directions, and with `upright_too` also what is
/// reachable with R = 1; tight to some per cent. Empty if that is proven to be nothing. Of machines without bounds the
/// box of what a sample found, a cell wider. Errors: those of volume().
/// Cost: 0.1 to 1 s.
Result<Extent> extent(const AnyMachine& machine, const Options& options, bool upright_too);

struct InsidePoints {
  std::vector<std::size_t> points;  ///< of the grid, rising
  double volume = 0;                ///< m^3 of the whole workspace, the middle of its bounds
  double lower = 0, upper = 0;
};
/// The points of the grid that belong to the workspace: proven where a run of volume() to 2 % or 100 000 boxes settles
/// them, by the margin of field() in the boxes that remain on the boundary. With `points_alone`, where the volume is
/// not asked for, up to 2000 points of one direction are judged by their margin alone. Errors: those of volume(). Cost:
/// 0.1 to 2 s, of machines whose coordinates follow some minutes, and 15 us a point near the boundary.
Result<InsidePoints> points_inside(const AnyMachine& machine, const Options& options, const Grid& grid,
                                   bool points_alone = false);

/// A closed line in a plane.
using Loop = std::vector<Vec3>;

/// A field on a plane with the boundary of the workspace in it.
struct Section {
  machine::Task task = machine::Task::pose;  ///< whose points these are
  Plane plane;
  Field field;
  std::vector<Loop> border;  ///< where the margin is 0; inside lies to the left, seen against step[0] x step[1]
  double area = 0;           ///< m^2 inside the boundary, or in the units of two coordinates
};
/// The section of the workspace by a plane, `resolution` points along its longer side. Each vertex of the boundary lies
/// on the true boundary (a root on an edge of the grid, to 1e-6 of the edge). Errors: those of field() and grid_on(),
/// WS131 (nothing is reachable with R = 1 nor from the required directions). Cost: 0.1 ms a point.
Result<Section> section(const AnyMachine& machine, const Options& options, const Plane& plane, int resolution,
                        const FieldOptions& field_options = {});
/// The same where `box` = extent(machine, options, true) is known, which takes most of the time of a machine whose
/// volume takes long.
Result<Section> section(const AnyMachine& machine, const Options& options, const Plane& plane, const Extent& box,
                        int resolution, const FieldOptions& field_options = {});

}  // namespace polypod::workspace
