// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Joint compliances from measured displacements of the tool tip under known forces (SLAV 4.3).
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "polypod/core/csv.hpp"
#include "polypod/core/error.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod::statics {

/// One point of a measurement: the tip's displacements under a force along x, y and z, one at a time.
struct MeasuredPoint {
  Pose X_MT;                         ///< the tool's pose in M (A = B = 0 in SLAV)
  double force = 0;                  ///< N, above 0: the same along each axis, or the largest size of `own_forces`
  Mat3 displacement = Mat3::Zero();  ///< m; column j: (dx, dy, dz) under the force along axis j; 0 where not given
  Place place;                       ///< the row of the file
  /// N, along x, y and z, where they differ or push the other way; 0 where there was no force along that axis.
  std::optional<Vec3> own_forces = {};
  /// Which displacements were measured: all of them, or fewer in a partial test.
  Eigen::Array<bool, 3, 3> given = Eigen::Array<bool, 3, 3>::Constant(true);
  std::vector<double> joints_user = {};  ///< the columns q1..qn, deg or mm; empty where the file has none
  double sigma = 0;                      ///< m, the column sigma_um: standard deviation of a displacement; 0: not said

  [[nodiscard]] Vec3 forces() const { return own_forces.value_or(Vec3::Constant(force)); }
  /// All nine displacements are there.
  [[nodiscard]] bool whole() const { return given.all(); }
  [[nodiscard]] std::size_t equations() const { return static_cast<std::size_t>(given.count()); }
  /// C F of the three forces: column j the displacement under the force along axis j, m; 0 where none was measured.
  [[nodiscard]] Mat3 computed(const Mat3& C) const {
    return given.select((C * forces().asDiagonal()).array(), 0.0).matrix();
  }
};

/// What the files of one measurement hold.
struct Displacements {
  std::vector<MeasuredPoint> points;
  std::vector<std::size_t> of_file;         ///< how many points each file has
  std::vector<std::string> unused_columns;  ///< "operator", each once: columns that no name is near to
};

/// Reads the columns x_mm, y_mm, z_mm, force_N, dx_Fx_um, dy_Fx_um, ..., dz_Fz_um (any order; a_deg, b_deg and c_deg if
/// given, else 0; q1..qn, deg or mm; sigma_um; lines that begin with # are remarks). Fx_N, Fy_N, Fz_N in place of
/// force_N give each direction a force of its own; forces may push or pull. Displacements whose columns are not there
/// or whose cells are blank are left out. Errors: ID100 a column is missing, ID101 not a number, ID102 no rows, ID103 a
/// row twice, in one file or in two, ID104 a force of 0, ID105 displacements that look like another unit, ID108 a
/// column whose name is nearly a known one.
Result<Displacements> read_displacements(const std::vector<std::string>& files, const csv::Columns& columns = {});
/// The points of one file.
Result<std::vector<MeasuredPoint>> read_displacements(const std::string& path);

/// The joints in which the machine stood at the point: of the inverse solutions within the limits the first, or where
/// the file gives joints the one nearest to them. Errors: ID111 a pose out of reach, ID146 joints that do not give the
/// pose (more than 10 mm or 1 deg off), ID147 another number of joints than the machine has.
Result<machine::JointVector> joints_of(const AnyMachine& machine, const MeasuredPoint& point);
/// The 3 x 3 compliance of the tip in these joints, m/N. Errors: those of joints_of.
Result<Mat3> computed_compliance(const AnyMachine& machine, const MeasuredPoint& point);

struct Outlier {
  std::size_t point = 0;  ///< index into the measurements
  int direction = 0;      ///< 0..2: displacement along x, y, z
  int force_axis = 0;     ///< 0..2
  double residual = 0;    ///< m
};

struct Identification {
  std::vector<double> compliance;  ///< rad/Nm or m/N, one a column of the Jacobian (joint), >= 0
  /// False where the readings say nothing of a compliance, as of a joint whose axis passes the tip: its standard error
  /// would be more than ten times the largest compliance of its kind. It stays as the machine has it.
  std::vector<bool> told;
  std::vector<double> standard_error;  ///< of each; 0 where the bound c >= 0 holds it, nan where it is not identifiable
  std::vector<double> half_interval;   ///< half of the 95 % confidence interval
  std::vector<std::string> joint;
  std::vector<bool> turns;  ///< rad/Nm; else it slides or stretches, m/N
  double times_given = 1;   ///< mean of what was found over what the machine had; 1 where it had none
  /// Of those that the bound c >= 0 holds at 0: the one-sided 95 % upper bound, from what the readings alone say of the
  /// compliance, cut off below 0 (a normal distribution truncated at 0).
  std::vector<std::optional<double>> upper_bound;
  double residual_rms = 0;  ///< m, over all displacements
  double signal_rms = 0;    ///< m, of the displacements themselves
  double explained = 0;     ///< R^2 = 1 - |r|^2 / |d|^2
  std::size_t equations = 0;
  double condition = 0;                          ///< of the scaled equations: 1 tells all joints apart, 1e6 does not
  std::vector<std::vector<double>> correlation;  ///< of the estimates
  /// SI, of the estimates that the readings alone give, without the bound c >= 0: so a compliance that it holds at 0
  /// has a variance, too, and two standard deviations of it are no less than what `upper_bound` leaves open.
  Eigen::MatrixXd covariance{};
  double asymmetry_rms = 0;   ///< m, half the difference of the measured cross displacements
  std::size_t pairs = 0;      ///< of cross displacements of which both were measured; of none symmetry is not judged
  double noise = 0;           ///< m, of one displacement: stated, or from the asymmetry; 0 where neither tells it
  bool noise_stated = false;  ///< by the file or the caller
  /// Of the noise: infinite where it is stated, 0 where nothing tells it.
  double noise_freedoms = 0;
  /// m, what the joints leave for each degree of freedom, to be compared with the noise: of all equations where the
  /// noise is stated; else without half the differences of the cross displacements, of which the noise is made and to
  /// which a symmetric compliance adds nothing. The two are then independent.
  double misfit = 0;
  double misfit_freedoms = 0;
  /// So many times the noise the misfit may be: 1.5, and more where chance alone makes more (F test, one in 200).
  double misfit_limit = 0;
  /// The asymmetry is no more than noise. With a stated one: at most 1.5 times what it explains, or what chance makes
  /// of it (one in 200). Else: no pair of cross displacements is off by a constant (more than its scatter, and more
  /// than chance makes, one in 200), and all are within a fifth of the signal.
  bool symmetric = true;

  /// Whether noise and misfit are known well enough to be compared.
  [[nodiscard]] bool noise_known() const { return noise_freedoms > 0 && misfit_freedoms > 0; }
  /// More than noise is left over; 1e-9 m is what a file's digits leave. Never where the noise is not known.
  [[nodiscard]] bool more_than_noise() const { return noise_known() && misfit > misfit_limit * noise + 1e-9; }
  std::vector<std::pair<int, int>> hardly_apart;  ///< columns whose estimates correlate by more than 0.9
  std::vector<Outlier> outliers;  ///< residuals beyond 3.5 robust standard deviations; they are kept in the fit
  std::vector<Mat3> residuals;    ///< m, measured less computed, like MeasuredPoint::displacement
};

/// Least squares with c >= 0 on 9 equations a point (fewer in partial tests), all displacements with equal weight, or
/// over their standard deviations where each row states one (sigma):
///   delta_i = sum_k c_k (J_k J_k^T F)_i   (SLAV (4.38), linear in c: no starting value is needed).
/// Standard errors from the residuals: s^2 (A^T A)^-1, s^2 = |r|^2 / (equations - joints).
/// `noise`: standard deviation of a displacement, m; 0: that of the files (sigma), else from the asymmetry of the cross
/// displacements, which knows no model. Errors: ID110 fewer equations than joints, ID111, ID146, ID147 as joints_of,
/// ID112 poses that cannot tell the joints apart or load none, ID116 displacements against the forces.
/// Cost: linear in the points, below 1 ms for 90.
Result<Identification> identify_compliance(const AnyMachine& machine, const std::vector<MeasuredPoint>& points,
                                           double noise = 0);

/// Measured against computed: the root of the mean square of (displacement - C_X F) over all displacements, with the
/// compliances that the machine has, m. Errors: those of joints_of.
Result<double> prediction_rms(const AnyMachine& machine, const std::vector<MeasuredPoint>& points);

}  // namespace polypod::statics
