// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Quality over a workspace: conditioning and errors at the points of a grid, from all directions.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "polypod/quality/errors.hpp"
#include "polypod/workspace/beyond.hpp"
#include "polypod/workspace/field.hpp"

namespace polypod::quality {

struct SurveyOptions {
  workspace::Options workspace;  ///< directions, limits, threads, cancelled
  int resolution = 24;           ///< points along the longest side, 2 to 512
  /// A box of points instead of the whole workspace; its corners are points of the grid.
  std::optional<std::array<Vec3, 2>> box;
  std::function<void(double)> progress;  ///< share of the work
};

/// Where a machine is looked at: points of M and orientations; of a task without x, y, z points of its three
/// coordinates, m and rad, which say the orientation (workspace::pose_at).
struct Survey {
  machine::Task task = machine::Task::pose;
  workspace::Grid grid;
  std::vector<std::size_t> inside;  ///< points of the grid in the workspace, rising
  std::vector<Mat3> orientations;   ///< all of these at each of them (workspace::sampled_orientations)
  double volume = 0;  ///< m^3 (in the coordinates of a task: their units): of the workspace to 5 % at least between its
                      ///< bounds, else by counting points; of a box the share of its points that are reachable
  double volume_lower = 0, volume_upper = 0;  ///< m^3, its proven bounds; both as `volume` where points were counted
  bool whole_box = true;                      ///< every point of a given box is in the workspace
  /// What searches between the points do not leave: a given box, or that of the angles of a task without x, y, z.
  std::optional<std::array<Vec3, 2>> box;
  /// Points of the workspace (and the box) that lie farthest along the axes and diagonals of M, m: where searches for
  /// extremes start beside the grid's points. Seen, not proven.
  std::vector<Vec3> tips;
  /// A reachable pose at a point or between neighbours at which the drives do not hold the tool (singular, type 2),
  /// and the determinant of A changes its sign: errors grow beyond all bounds towards it. None found proves nothing.
  std::optional<Pose> singular;
  workspace::BeyondSingular beyond;  ///< of the poses at its points that were looked at (side_of_home)
};

/// The points of the workspace. Errors: those of workspace::volume(), WS130, QU110 (no point of the grid is inside).
Result<Survey> survey(const AnyMachine& machine, const SurveyOptions& options);

/// One number at each point inside: its mean over the directions, as JEL takes it, and its worst.
struct Quantity {
  std::vector<double> mean, worst;   ///< no number where no direction has joints
  std::vector<int> worst_direction;  ///< of Survey::orientations
};

/// Over the points of a survey.
struct Statistics {
  double min = 0, mean = 0, max = 0, stddev = 0;
  Vec3 min_at = Vec3::Zero(), max_at = Vec3::Zero();  ///< points
};
/// Of one number a point. Values that are not finite count for min and max alone; mean and stddev are no numbers where
/// there is no finite one.
Statistics statistics(const Survey& survey, const std::vector<double>& values);

/// Where a quantity is largest of all its worst values at the points of the grid.
struct Extreme {
  Pose X_MT;
  double value = 0;
};
Extreme worst_of(const Survey& survey, const Quantity& quantity);

/// Up to three quantities at one point over some directions: their means and their worst.
struct PointValues {
  std::array<double, 3> mean{}, worst{};
  std::array<int, 3> worst_direction{};
};
/// The quantities of a field, in the order of its members, wherever else one looks. The machine must outlive them.
struct Anywhere {
  std::function<PointValues(const Vec3& p)> at_point;  ///< over the survey's directions
  std::function<std::array<double, 3>(const Pose& X_MT, const JointVector& q)> at_pose;
};

/// The statistics of the means with the least and the largest looked for between the points and on the boundary of the
/// workspace, too: from the best four points of the grid and the best four of its tips by a direct search over the
/// position (steps of half the spacing down to a thousandth of it, along the boundary where it is met). `number` is the
/// quantity's place in the field. These are the least and the largest SEEN, not bounds: a sharper peak may lie between.
/// Cost: some thousand calls of at_point.
Statistics statistics_seen(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options,
                           const Quantity& quantity, const Anywhere& anywhere, std::size_t number);

/// The worst pose seen: the same search over the position and both angles of the direction. `sign` 1: the largest is
/// the worst; -1: the least. Seen, not a bound. Infinite values are as they are; where the survey holds a singular pose
/// the worst is there, infinite, or 0 for -1. Over one direction it is the least or
/// the largest of statistics_seen, the same number at the same place.
Extreme worst_seen(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options,
                   const Quantity& quantity, const Anywhere& anywhere, std::size_t number, double sign = 1);

struct DexterityField {
  Quantity condition, sigma_min, determinant;  ///< as kinematics::dexterity; |det|; worst: largest, least, least
  double length = 0;                           ///< the characteristic length, m; 0 where it changes with the pose
  Anywhere anywhere;
};
/// Cost a pose: 0.15 us for hexapods, four at a time; 1 us for deltas, 1.6 us for arms.
Result<DexterityField> dexterity_field(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options,
                                       double length = 0);

struct ErrorField {
  Quantity position, orientation;  ///< m, rad
  Anywhere anywhere;
};
/// The lengths of known_error at each pose. Where they are beyond 1e9 times the sizes, they are rounding at a singular
/// pose (kinematics::kNoHold), and infinite.
Result<ErrorField> known_error_field(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options,
                                     const std::vector<Sized>& errors);
/// worst_case at each pose, infinite as for known_error_field. Cost a pose: 0.2 us for hexapods whose elements each act
/// on one leg (all but the tool's length), four at a time; otherwise that of worst_case.
Result<ErrorField> tolerance_field(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options,
                                   const std::vector<Sized>& tolerances, const ToleranceOptions& tolerance = {});

/// The pose of a survey: point number `point` of `inside`, from direction number `direction`.
Pose pose_at(const Survey& survey, std::size_t point, int direction);
/// The joints of a pose as the surveys take them: of a slider's roots the outer one where both are on the rail, of an
/// arm the first branch within the limits. Empty where there are none.
std::optional<JointVector> joints_at(const AnyMachine& machine, const Pose& X_MT);

}  // namespace polypod::quality
