// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Geometric calibration of any family: the parameters of the closure from what an instrument measured (KOZ 4.6.3).
#pragma once

#include <string>
#include <vector>

#include "polypod/calibration/checks.hpp"
#include "polypod/calibration/measurement.hpp"
#include "polypod/calibration/systematic.hpp"
#include "polypod/calibration/verdict.hpp"
#include "polypod/core/units.hpp"

namespace polypod::calibration {

/// How far a machine is off its drawing where nothing is stated, as standard deviations: a workshop's 0.1 mm and 0.05
/// deg (of directions 0.87 mm/m). The measurements correct both sizes (see calibrate).
inline constexpr double kUsualLengthError = 0.1e-3;
inline constexpr double kUsualAngleError = 0.05 * units::kRadPerDeg;

/// What a residual of r standard deviations counts for.
enum class Loss {
  none,      ///< r^2: right for normal noise
  huber,     ///< r^2 up to about three, then growing with |r|: the same for normal noise, and outliers pull little
  cauchy,    ///< log(1 + r^2): outliers hardly pull at all
  automatic  ///< huber; cauchy where a few rows pull huber far aside
};

struct CalibrationOptions {
  std::vector<std::string> only;  ///< beginnings of keys with unit, e.g. "base.joint"; empty: every parameter
  std::vector<std::string> hold;  ///< beginnings of keys that stay nominal
  bool estimate_frame = false;    ///< X_SM too, the machine in the instrument's frame
  bool estimate_target = false;   ///< p_TR too, the target in the tool's frame (and R_TR where poses were measured)
  /// The scale of the instrument too: it shows 1 + k times the lengths that are, about the origin of its frame.
  bool estimate_scale = false;
  Pose X_SM;  ///< where the machine stands in the instrument's frame: known, or a first guess
  Pose X_TR;  ///< where the target sits on the tool: known, or a first guess
  /// Standard deviations of the instrument, m and rad. Only their ratio to each other and to the priors matters for the
  /// values; standard errors come from the residuals.
  double noise_position = 20e-6;
  double noise_angle = 35e-6;
  double prior_length = 0;  ///< m: how far lengths may be off the nominal ones, as a standard deviation; 0: not stated
  double prior_angle = 0;   ///< rad, the same for angles (and for numbers without a unit)
  double bound_length = 0;  ///< m: hard bounds round the nominal lengths; 0: none
  double bound_angle = 0;   ///< rad
  Loss loss = Loss::automatic;
  /// This share of the poses, evenly spread, is judged by a fit of the others; 0 to 0.5. All rows enter the last fit.
  double hold_back = 0.2;
  /// Errors that all readings share (GUM type B). They change no value; what they do to the parameters goes into the
  /// covariance (see calibrate).
  std::vector<Systematic> systematic;
};

/// A change of a held parameter by 1 looks like a change of this unknown by `factor` (both SI), together with its
/// further Likes.
struct Like {
  std::string key, unit;
  double factor = 0;
};

struct Estimate {
  std::string key, unit;
  double nominal = 0, value = 0;  ///< SI
  double standard_error = 0;      ///< SI; what measurements and priors leave open, systematic parts included
  bool identifiable = false;
  bool at_bound = false;   ///< a hard bound holds it: the error is larger than allowed, or no error of this parameter
  std::vector<Like> like;  ///< of a parameter that is not identifiable, the strongest first
  double standard_error_readings = 0;  ///< without systematic parts
  /// A 95 % interval is so many standard errors on each side: Student's t with the effective degrees of freedom (Welch
  /// and Satterthwaite, GUM G.4), systematic parts counting as known exactly.
  double student = 1.96;
};

struct RowResidual {
  std::size_t row = 0;            ///< index into the measurements
  Eigen::VectorXd before, after;  ///< computed less measured: m, then rad (axis, pose)
  int lengths = 0;                ///< how many of them are m
  double weight = 1;              ///< of the robust loss, in the last step
  double share = 1;               ///< for how many independent rows it counts: less than 1 for repeats (see Repeats)
  bool held_back = false;         ///< of the fit that judges; `after` is of the last one, into which all rows went
  Eigen::VectorXd judged{};       ///< of a row of the validation set: what the fit without these rows leaves of it
  bool outlier = false;           ///< beyond (sqrt(equations) + 3) robust standard deviations, or lost
  bool lost = false;              ///< the calibrated machine does not assemble there: near a singular pose; not fitted
  bool untaken = false;           ///< lost because the nominal machine cannot take these joints; before and after are 0
};

/// Root of the mean square over the equations that are lengths, m, without rows marked as outliers; `all_`: with them
/// (those that are lost aside).
struct Score {
  std::size_t rows = 0, outliers = 0;
  double rms_before = 0, rms_after = 0, max_after = 0;
  double all_before = 0, all_after = 0;
  double angle_before = 0, angle_after = 0;  ///< rad, over the equations that are angles
};

struct Calibration {
  AnyMachine machine;  ///< with the found parameters and a note where they come from
  std::vector<Estimate> parameters;
  std::size_t rank = 0;  ///< parameters that these measurements tell
  Pose X_SM, X_TR;
  Vec6 frame_error = Vec6::Zero(), target_error = Vec6::Zero();  ///< standard errors: m, rad; 0 where given or held
  std::vector<std::string> held_beside;                          ///< parts of frame and target, not identifiable
  double scale = 1, scale_error = 0;                             ///< of the instrument, where it was looked for
  /// `fitted`: all rows in the last fit; `held_back`: those of the validation, in a fit of the others.
  Score fitted, held_back;
  std::vector<RowResidual> residuals;  ///< one a measurement
  /// Of all parameters of the machine, in their order, SI: what is known of them after the measurements, and before,
  /// from the priors (standard deviations `prior`) and the rules that parameters keep (|u| = 1). 0 for those that are
  /// held; those that were not looked for (CalibrationOptions::only) keep their priors, and what they do to the others
  /// counts.
  Eigen::MatrixXd covariance, covariance_before;
  /// Parts of `covariance`, which is their sum: what the scatter of the readings does (type A, with free_equations
  /// degrees of freedom), what the priors leave open of the drawing, and what systematic parts do.
  Eigen::MatrixXd covariance_readings, covariance_drawing, covariance_systematic;
  std::vector<SystematicEffect> systematic;  ///< one by one
  Eigen::VectorXd prior;
  Verdict verdict;
  /// No angle of the tool is left open (see Verdict::left_open).
  bool orientation_told = true;
  std::size_t equations = 0;        ///< fitted ones
  double condition = 0;             ///< of the equations, columns scaled to unit length
  double noise_factor = 0;          ///< residuals over the noise that was given: 1 if it was right
  double noise_factor_judging = 0;  ///< the same of the fit without the validation set; without one noise_factor
  double free_equations =
      0;  ///< equations (weighted) beyond those that the parameters take up; noise_factor is from them
  /// The unknowns that were looked for (a direction of three numbers is two unknowns), and how many of them these
  /// measurements tell.
  std::size_t unknowns = 0, told = 0;
  double taken_up = 0;      ///< equations that the parameters take up
  double chi_square = 0;    ///< weighted squares of the residuals over the noise given, to be free_equations
  double chi_square_p = 1;  ///< how likely chance makes it as large
  /// A 95 % interval is so many standard errors on each side: Student's t with free_equations degrees of freedom.
  double student = 1.96;
  bool others_uncertain = false;    ///< parameters that were not looked for count with their priors
  std::vector<CommonChange> tried;  ///< common errors in place of the machine's; the likely one first
  std::vector<Moved> moved;
  Repeats repeats;
  Drift drift;
  double change = 0;  ///< root mean square of the parameters' changes over their default or stated priors
  /// By how many standard deviations the squares of the fitted residuals have become smaller than mere noise would let
  /// them; below about 3 the drawing explains the readings.
  double gain = 0;
  int iterations = 0;
  bool pulled_aside = false;  ///< Loss::automatic took cauchy's, because a few rows pulled huber's aside
};

/// Minimises the squared residuals of the rows over the chosen parameters p (and frame, target, places of contact) with
/// Levenberg-Marquardt (Ceres). Each residual is what the instrument would see of the pose X(q, p) that solves
/// F(X, q, p) = 0, less what it saw; derivatives by dX = -A^-1 F_p dp, exact at every step. The robust loss counts in
/// standard deviations found from the residuals themselves, so a wrong guess of the noise does no harm. Loss::automatic
/// is huber; where that leaves residuals above three times the noise given, or fails, and cauchy leaves less than half
/// of them, cauchy: a few rows near singular poses then pulled the rest aside.
///
/// Rows where the machine does not assemble with what was found stand near singular poses, where a hair of error moves
/// the tool by millimetres or leaves no pose at all: they are marked `lost` and the search begins again without them;
/// those that assemble then come back once.
///
/// Each parameter has a prior round its nominal value (stated, or kUsualLengthError and kUsualAngleError, whose sizes
/// the measurements correct by their likelihood; MacKay, Bayesian Interpolation, 1992); the sum that is minimised is
/// that of |r|^2 / s^2 and (change / prior)^2, s the noise that the residuals show. So what the measurements cannot
/// tell stays at the drawing: among machines that explain them equally well the least change in units of the priors is
/// taken, and with right priors no coordinate of the pose gets worse in the mean square: the covariance (J^T W J / s^2
/// + P^-2)^-1 is below P^2. A direction that the measurements tell with the standard error e is off by (e / prior)^2 of
/// its change, which is e / prior of its standard error where it is one prior long.
///
/// Systematic parts (CalibrationOptions::systematic) are propagated, not fitted: with the gradient of the sum above, an
/// error b that all readings share moves the solution by S b, S = -(J^T W J / s^2 + P^-2)^-1 J^T W J_b / s^2, and S u^2
/// S^T is added to the covariance (Schmidt's consider analysis; GUM 5.1.2 of independent b). So values do not depend on
/// what is stated of the instrument, and contributions add up in squares.
///
/// Identifiable, for rank and names (see Estimate::like), is an unknown whose change by 1 % of the machine's size
/// (0.01 rad) does not hide in the noise behind those before it. Order: contacts, frame, target, then parameters by
/// their own order.
///
/// Errors: CA110 (not more equations than unknowns without a prior), CA111 (more than a tenth of the rows have
/// joints that the nominal machine cannot take), CA112
/// (the measured places lie on a line or in one point), CA113 (measured lengths are off by a factor: another unit?),
/// CA114 (an unknown key), CA115 (the search does not converge, or more than
/// a tenth of the rows is lost), CA116 (an option out of range), CA117 (a place that is
/// touched once only), CA118 (the residuals stay above 100 times the noise), CA151 (a systematic part that readings of
/// places do not have), MA104. Cost: about 30 us a row and step;
/// below 0.3 s for 100 points of a hexapod.
Result<Calibration> calibrate(const AnyMachine& nominal, const std::vector<Measurement>& rows,
                              const CalibrationOptions& options = {});

/// A command for a controller that knows the nominal machine only.
struct CorrectedTarget {
  Pose command;        ///< what to ask the controller for
  JointVector joints;  ///< where its nominal inverse puts the joints
  double rest = 0;     ///< m: by how much the real machine still misses (angles times 1 m)
  bool reached = false;
  std::string reason;
};
/// The command whose nominal joints bring the real (calibrated) machine to the pose X_MT: command <- command + (X_MT -
/// forward_real(inverse_nominal(command))) from X_MT on, which contracts by the size of the calibration's change a
/// step. Not reached where a command leaves the nominal machine's limits.
CorrectedTarget corrected_target(const AnyMachine& nominal, const AnyMachine& real, const Pose& X_MT);

}  // namespace polypod::calibration
