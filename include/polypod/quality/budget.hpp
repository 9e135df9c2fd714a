// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The error budget of a machine at a pose, ordered as SLAV 3.1 orders it: resolution, repeatability, geometric and
// non-geometric errors.
#pragma once

#include <string>
#include <vector>

#include "polypod/quality/errors.hpp"

namespace polypod::quality {

/// The same error of every joint of a kind.
struct JointError {
  double sliding = 0;  ///< of sliding joints and struts, m
  double turning = 0;  ///< of turning joints, rad
};

/// What is known of the machine's imperfections.
struct Imperfections {
  std::vector<Sized> tolerances;   ///< of the elements: geometric
  JointError resolution;           ///< of each joint (BRU): half of it may be missing
  JointError repeatability;        ///< of each joint, three standard deviations
  JointError backlash;             ///< of each joint: half of it either way
  double warming = 0;              ///< K above the temperature of the nominal lengths
  double expansion = 12e-6;        ///< 1/K
  Vec6 deflection = Vec6::Zero();  ///< of the tool under its load (statics::compliance_at)
  /// Of the calibrated parameters, SI, in the order of kinematics::parameters; empty: none is known.
  Eigen::MatrixXd covariance{};
};

struct BudgetRow {
  std::string source;
  std::string kind;        ///< "system", "statistical", "geometric" or "non-geometric"
  double position = 0;     ///< m
  double orientation = 0;  ///< rad
  std::string how;         ///< how it was found
};

struct Budget {
  std::vector<BudgetRow> rows;
  /// SLAV (3.1): half the resolution plus all that is not statistical; what the tool may miss at the worst.
  double accuracy = 0, accuracy_orientation = 0;
  /// The same with rows added as squares, as independent errors do.
  double accuracy_rss = 0, accuracy_rss_orientation = 0;
  double repeatability = 0, repeatability_orientation = 0;
};

/// Resolution, backlash and tolerances: the exact worst case (worst_case). Repeatability: root sum square of the
/// joints' scatter along the worst direction. Calibration: U (k = 2) along the direction in which it is largest, of the
/// tip (kinematics::tip_covariance) and of the orientation as orientation_error measures it; tolerances of what was
/// calibrated would count the same twice. Warming: every length of the machine grows alike, as a known error. Rows
/// that are 0 are kept, so that a reader sees what was not given. Errors: those of worst_case.
Result<Budget> budget(const AnyMachine& machine, const Pose& X_MT, const JointVector& q, const Imperfections& known);

}  // namespace polypod::quality
