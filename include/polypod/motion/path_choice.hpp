// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a path leaves open, chosen so that the machine can pass the whole of it (JEL 7.2), and how good a path is (7.1).
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "polypod/motion/machine_motion.hpp"

namespace polypod::motion {

/// The rotation about the tool axis at the start and the end of each stretch, as far as a rotating tool leaves it open.
struct RotationChoice {
  PosePath path;               ///< with the rotation
  bool passes = false;         ///< the whole path can be passed with it
  std::vector<double> angles;  ///< rad, at the start of each stretch and at the end of the last
  bool constant = true;        ///< one angle for the whole path
  double condition = 0;        ///< the largest on the path
  std::size_t tried = 0;       ///< angles, or steps between angles
};
/// One angle for the whole path where there is one with which it can be passed: of those in steps of 5 deg the one
/// whose largest condition number is the smallest. Else an angle for each point, linear between them, by dynamic
/// programming over steps of 15 deg with at most 60 deg a stretch: the least largest condition number again; not for
/// paths of more than 60 stretches. A path for which none is found may have one between the steps.
RotationChoice choose_rotation(const AnyMachine& machine, const PosePath& path, const MoveOptions& options);

/// A point that was put in: the tool turns there on the spot.
struct InsertedPoint {
  std::size_t stretch = 0;  ///< of the path that was given
  int line = 0;
  Vec3 p = Vec3::Zero();
  Vec3 angles = Vec3::Zero();  ///< A, B, C behind the turn, rad
};
struct Insertion {
  PosePath path;
  bool passes = false;
  std::vector<InsertedPoint> points;
};
/// Where a stretch cannot be passed though its ends can be reached, points are put in that have the position of its
/// ends and another orientation (JEL 7.2): first the turn and then the way, first the way and then the turn, or on
/// the way the orientation of home. Of a stretch with a duration, each turn takes a quarter of it.
Insertion insert_points(const AnyMachine& machine, const PosePath& path, const MoveOptions& options);

/// What a pose is worth along a path.
enum class Goal { sigma_min, determinant, inverse_condition };
struct PathQuality {
  double f = 0;         ///< (p + (1 - p) integral) / length
  double integral = 0;  ///< of the goal over the path, mm
  double length = 0;    ///< mm
  double least = 0;     ///< of the goal on the path
};
/// JEL (7.1), lengths in mm, the integral by the trapezoidal rule over points that are `step` apart at most. `weight`
/// p: 1 counts the length alone, 0 the mean of the goal. Empty where a point is out of reach.
std::optional<PathQuality> quality_of(const AnyMachine& machine, const PosePath& path, const MoveOptions& options,
                                      Goal goal, double weight);

}  // namespace polypod::motion
