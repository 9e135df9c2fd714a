// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Joint compliances from measured displacements of the tool tip under known forces (SLAV 4.3).
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod::statics {

/// One point of a measurement: the tip's displacements under a force along x, y and z, one at a time.
struct MeasuredPoint {
  Pose X_MT;                         ///< the tool's pose in M (A = B = 0 in SLAV)
  double force = 0;                  ///< N, the same along each axis
  Mat3 displacement = Mat3::Zero();  ///< m; column j: (dx, dy, dz) under the force along axis j
  Place place;                       ///< the row of the file
};

/// Reads the columns x_mm, y_mm, z_mm, force_N, dx_Fx_um, dy_Fx_um, ..., dz_Fz_um (any order; a_deg, b_deg and c_deg if
/// given, else 0; lines that begin with # are remarks). Errors: ID100 a column is missing, ID101 not a number, ID102 no
/// rows, ID103 a row twice, ID104 a force that is not above 0, ID105 displacements that look like another unit.
Result<std::vector<MeasuredPoint>> read_displacements(const std::string& path);

struct Outlier {
  std::size_t point = 0;  ///< index into the measurements
  int direction = 0;      ///< 0..2: displacement along x, y, z
  int force_axis = 0;     ///< 0..2
  double residual = 0;    ///< m
};

struct Identification {
  std::vector<double> compliance;      ///< rad/Nm or m/N, one a column of the Jacobian (joint), >= 0
  std::vector<double> standard_error;  ///< of each; 0 where the bound c >= 0 holds it
  std::vector<double> half_interval;   ///< half of the 95 % confidence interval
  std::vector<std::string> joint;
  std::vector<bool> turns;  ///< rad/Nm; else it slides or stretches, m/N
  double times_given = 1;   ///< mean of what was found over what the machine had; 1 where it had none
  double residual_rms = 0;  ///< m, over all displacements
  std::size_t equations = 0;
  double condition = 0;                          ///< of the scaled equations: 1 tells all joints apart, 1e6 does not
  std::vector<std::vector<double>> correlation;  ///< of the estimates
  double asymmetry_rms = 0;                      ///< m, half the difference of the measured cross displacements
  bool symmetric = true;  ///< it is not above 1.5 times what the noise of the direct displacements explains
  std::vector<std::pair<int, int>> hardly_apart;  ///< columns whose estimates correlate by more than 0.9
  std::vector<Outlier> outliers;  ///< residuals beyond 3.5 robust standard deviations; they are kept in the fit
  std::vector<Mat3> residuals;    ///< m, measured less computed, like MeasuredPoint::displacement
};

/// Least squares with c >= 0 on 9 equations a point, all displacements with equal weight:
///   delta_i = sum_k c_k (J_k J_k^T F)_i   (SLAV (4.38), linear in c: no starting value is needed).
/// Standard errors from the residuals: s^2 (A^T A)^-1, s^2 = |r|^2 / (equations - joints).
/// Errors: ID110 fewer equations than joints, ID111 a pose out of reach, ID112 poses that cannot tell the joints apart,
/// ID116 displacements against the forces.
/// Cost: linear in the points, below 1 ms for 90.
Result<Identification> identify_compliance(const AnyMachine& machine, const std::vector<MeasuredPoint>& points);

/// Measured against computed: the root of the mean square of (displacement - C_X F) over all displacements, with the
/// compliances that the machine has, m. Errors: ID111.
Result<double> prediction_rms(const AnyMachine& machine, const std::vector<MeasuredPoint>& points);

}  // namespace polypod::statics
