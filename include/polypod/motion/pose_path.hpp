// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Paths of poses: stretches of lines, arcs and blends on which the tool also turns.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/motion/joint_series.hpp"
#include "polypod/motion/path.hpp"

namespace polypod::motion {

/// How the orientation goes from one point to the next.
enum class Turning {
  angles,  ///< A, B and C each linearly, as a controller with rotary axes (and JEL 7.5) does
  turn     ///< about one axis, by the smallest turn, at a constant rate
};

/// A curve from one pose to another, by a parameter u from 0 to `size`: the length of the way in m, or of a turn on the
/// spot its angle in rad.
struct Stretch {
  enum class Curve { line, arc, blend } curve = Curve::line;
  double size = 0;
  double length = 0;  ///< m, of the tip's way; 0 of a turn on the spot
  Vec3 from = Vec3::Zero(), to = Vec3::Zero();
  /// Arcs: center + r (cos a u + sin a v) + rise n, a from 0 to `sweep`, r linear in a from `radius` to `radius_end`.
  Vec3 center = Vec3::Zero(), u = Vec3::UnitX(), v = Vec3::UnitY(), rise = Vec3::Zero();
  double radius = 0, radius_end = 0, sweep = 0;
  /// Blends: coefficients of u^0 to u^5 of x, y, z, m, and A, B, C, rad.
  Eigen::Matrix<double, 6, 6> polynomial = Eigen::Matrix<double, 6, 6>::Zero();

  Turning turning = Turning::angles;
  Mat3 before = Mat3::Identity();                             ///< R = before R_z(C) R_y(B) R_x(A): how the work lies
  Vec3 angles_from = Vec3::Zero(), angles_to = Vec3::Zero();  ///< A, B, C, rad
  Vec3 axis = Vec3::Zero();  ///< of Turning::turn the whole turn as rotation vector in M

  double spin_from = 0, spin_to = 0;  ///< rad, further turn about the tool axis, linear: R R_z(spin)

  double duration = 0;  ///< s, 0 where none is given
  double speed = 0;     ///< m/s, the largest that the tip may take here; 0: no limit of its own
  bool rapid = false;
  bool stop = false;  ///< the tool stands still where it ends
  /// s, for which the tool waits where it ends; of the first stretch of a path also where it begins.
  double wait = 0, wait_before = 0;
  int line = 0;  ///< of the program or file, 0: none
  /// Where the point that this stretch leads to was put in by Polypod.
  bool inserted = false;

  /// The pose at a parameter that itself moves: exact to the third order.
  [[nodiscard]] PoseSeries at(const Series& parameter) const;
  [[nodiscard]] Pose pose(double parameter) const;
  /// Whether the orientation changes on the way.
  [[nodiscard]] bool turns() const;
};

/// What happens where two stretches meet.
struct Junction {
  double corner = 0;     ///< rad, between the directions of the tip
  bool tangent = false;  ///< direction and rate of turning go on
  bool smooth = false;   ///< and so does the curvature: no jump of acceleration
};

struct PosePath {
  std::vector<Stretch> stretches;
  double length = 0;  ///< m
  double size = 0;    ///< of all parameters

  [[nodiscard]] Junction junction(std::size_t before) const;
};

struct TargetPose {
  Vec3 p = Vec3::Zero();       ///< m
  Vec3 angles = Vec3::Zero();  ///< A, B, C, rad
};

/// A straight way, on which the tool may turn; a turn on the spot where the points are one. Errors: MO100 (neither way
/// nor turn).
Result<Stretch> straight(const TargetPose& from, const TargetPose& to, Turning turning = Turning::angles);
/// An arc over `via`. Errors: MO102.
Result<Stretch> curved(const TargetPose& from, const Vec3& via, const TargetPose& to,
                       Turning turning = Turning::angles);
/// Error: MO100 where there is none.
Result<PosePath> pose_path_of(std::vector<Stretch> stretches);

/// The same path with corners replaced: each corner, and each jump of curvature where `curvature` says so, by a
/// polynomial of fifth degree that goes on with the direction and the curvature of both sides and leaves the corner by
/// `deviation` m at most. Corners at which the tool stops by its program (`stop`) or waits, turns on the spot and
/// stretches that turn about one axis are left as they are; a blend takes at most half of either stretch.
PosePath blended(const PosePath& path, double deviation, bool curvature);

/// The same path with a largest speed of the tip, m/s, wherever no stretch has its own.
PosePath with_speed(PosePath path, double speed);

/// A part of a stretch that is no blend, from a to b of its parameter.
Stretch part_of(const Stretch& stretch, double a, double b);

/// How the drives go along a stretch in the times that a file gives.
enum class Profile {
  linear,  ///< at a constant rate from point to point (JEL 7.5): the speed jumps at each point
  smooth,  ///< from rest to rest with a polynomial of fifth degree
  /// Through all points without a stop: a spline of fifth degree over time, at rest at both ends and at both ends of
  /// each wait, with continuous derivatives up to the fourth. It leaves the straight ways between the points.
  spline
};

struct PosePathFile {
  PosePath path;
  double speed = 0;    ///< m/s, 0 where the file gives none
  bool timed = false;  ///< every stretch has its duration
  Profile profile = Profile::linear;
  bool angles = false;  ///< the file gives orientations
};

/// The path that goes through the same points in the same times as a spline (Profile::spline). Errors: MO112 (a stretch
/// that is no line, or turns about one axis). Cost: linear.
Result<PosePath> splined(const PosePath& path);
/// How far a path of splines leaves the straight ways between its points, and its angles A, B, C those that go linearly
/// with the time: the largest found.
struct ChordError {
  double length = 0, angle = 0;  ///< m, rad
};
ChordError farthest_from_chords(const PosePath& path);

/// Reads a path file.
/// TOML: `start_mm` (optional where `start_deg` is there and no segment has a place), `start_deg` (A, B, C, optional),
/// `speed_mm_per_s`, `turning` ("angles", "turn"), `profile`
/// ("linear", "smooth", "spline"), `segments = [{ to_mm, via_mm, to_deg, time_s, speed_mm_per_s, stop }]`; each of a
/// segment's keys may be left out: the point or the orientation then stays. A segment that leaves both as they are is a
/// wait of `time_s`. CSV: a row a point with `x_mm,y_mm,z_mm` and, as they are given, `a_deg,b_deg,c_deg` and `time_s`
/// (rising); a row with the pose of the row before is a wait. The profile is linear. Errors: MO100, MO102, MO111 (a
/// duration of some stretches alone), MO112 (an unknown word), MO113 (times that do not rise), FI100 and those of
/// config and csv.
/// `needed`: the columns that a CSV file must have; x, y and z that it leaves out are 0.
Result<PosePathFile> read_pose_path(const std::string& file,
                                    const std::vector<std::string>& needed = {"x_mm", "y_mm", "z_mm"});

}  // namespace polypod::motion
