// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How well the tool's pose is known before and after a calibration, and what follows from that.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "polypod/calibration/measurement.hpp"

namespace polypod::calibration {

/// The coordinates of the tool's pose that the machine's task has, with unit: "x_mm", "y_mm", "z_mm", then "a_deg" and
/// "b_deg" for five axes, "a_deg", "b_deg" and "c_deg" for six.
std::vector<std::string> pose_coordinates(const AnyMachine& machine);

/// Standard deviations of these coordinates at the pose X_MT of the joints q, m and rad, for parameters with the
/// covariance `covariance` (SI, in the order of kinematics::parameters): the roots of the diagonal of S G C G^T S^T
/// with G = -A^-1 F_p, the twist of the tool in M by parameter, and S the task's part of it. Angles are small turns:
/// about x, y and z of M for six axes; for five, a and b about x and y of the tool. `machine` is the one that the
/// covariance is of, the calibrated one where measurements determine it: where the drawing is degrees off its G is
/// another. First order: near singular poses (A loses rank) the true spread is larger. Cost: 20 us.
Eigen::VectorXd pose_deviation(const AnyMachine& machine, const Pose& X_MT, const JointVector& q,
                               const Eigen::MatrixXd& covariance);

/// pose_deviation over poses of the workspace: those that random_stands draws, within all limits and not nearly
/// singular.
struct PoseSpread {
  Eigen::VectorXd mean, max;  ///< one value a coordinate of pose_coordinates, m and rad
};

/// The poses that a verdict judges: random_stands(machine, kJudgedPoses, kJudgedSeed).
inline constexpr std::size_t kJudgedPoses = 100;
inline constexpr std::uint64_t kJudgedSeed = 1;

enum class Answer {
  better,  ///< every coordinate of the pose is better known than from the drawing, by the measurements
  partly,  ///< some are; the others are known about as well as from the drawing
  no       ///< not better than the drawing by more than chance, or not to be trusted
};

struct Verdict {
  Answer answer = Answer::no;
  std::vector<std::string> left_open;  ///< coordinates (pose_coordinates) that the measurements do not tell
  std::string text;                    ///< one or two sentences: the answer, why, and what would tell more
  PoseSpread before, after;
  PoseSpread after_readings;  ///< after, without systematic parts
  std::size_t poses = 0;      ///< that were judged
};

}  // namespace polypod::calibration
