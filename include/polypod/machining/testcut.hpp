// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A test cut: a square boss whose walls are finished with several widths of cut, and what its measured sizes tell of
// the forces and of the compliance.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "polypod/machining/predict.hpp"

namespace polypod::machining {

struct TestCutPlan {
  double feed = 0;             ///< m/s
  double spindle_speed = 0;    ///< rev/s, clockwise
  double depth = 0;            ///< m, axial; 0: a quarter of the diameter
  std::vector<double> widths;  ///< m, of the finishing cut; rising; none: 0.05, 0.2 and 0.5 of the diameter
  double x = 0, y = 0;         ///< m, of the middle of the boss in G54; its top is Z0
  int tool = -1;               ///< T number; -1: the cutter of the job
};

/// One size of the boss: the distance between two opposite walls where both were finished with the same width of cut.
struct TestCutStep {
  char axis = 'x';         ///< along which it is measured
  double width = 0;        ///< m, of the finishing cut on both walls
  Vec3 at = Vec3::Zero();  ///< m, in G54: the middle of the line to measure along, at half depth
  double nominal = 0;      ///< m
  int lines[2] = {0, 0};   ///< of the program: where the two walls are finished
};

struct TestCut {
  TestCutPlan plan;  ///< with the defaults filled in
  std::string text;  ///< the G-code program
  std::vector<TestCutStep> steps;
  Vec3 block_min = Vec3::Zero(), block_max = Vec3::Zero();  ///< m, in G54: the block to be clamped
};

/// A square boss of as many stretches a side as there are widths, each three diameters long. A roughing pass in a slot
/// round it leaves at each stretch its width of cut, the same on opposite sides; a finishing pass takes it,
/// down-milling. So all sizes of a direction would be equal on a rigid machine, and how they differ does not depend on
/// the cutter's diameter. Errors: MC410 widths that do not rise, or not between 0 and the diameter, fewer than two;
/// MC411 a depth beyond the cutter's edges, a feed or speed that is not above 0.
Result<TestCut> test_cut(const Job& job, const TestCutPlan& plan);

/// The sizes of the steps as the job foretells them, with its cutting forces multiplied by `force`, m: nominal plus the
/// mean normal errors of both walls along the middle diameter of each stretch. `notes`: where to put what a reader
/// should know of the cut (condition_notes). Errors: those of predict; MC414 a wall that is off by more than a quarter
/// of the cutter's diameter.
Result<std::vector<double>> predicted_sizes(const Job& job, const TestCut& cut, double force,
                                            std::vector<std::string>* notes = nullptr);

/// A factor and its standard uncertainty.
struct Factor {
  double value = 1;
  double uncertainty = 0;
};

struct TestCutReading {
  std::size_t step = 0;
  double size = 0;   ///< m
  double sigma = 0;  ///< m, standard uncertainty of the reading, above 0
};

/// What the sizes tell. The deflection is C(x) F: sizes know the product of a factor of the compliance and one of the
/// forces, no more. A diameter that is off by d makes every size smaller by d.
struct TestCutFit {
  Factor product;
  Factor diameter;                ///< m, by how much the cutter is larger than the job says
  std::vector<double> before;     ///< m, of each reading: measured less foretold by the job, with its own best diameter
  std::vector<double> after;      ///< m, the same with the factor
  double rms_before = 0;          ///< m
  double rms_after = 0;           ///< m
  double chi_squared = 0;         ///< of `after` over the readings' sigma
  int freedom = 0;                ///< readings less the two that were fitted
  double chi_squared_99 = 0;      ///< what it stays below with 99 %, if one factor explains the sizes
  std::optional<std::string> no;  ///< why nothing follows from the sizes
};

/// Weighted least squares for the product and the diameter, by Gauss's and Newton's method on predictions of the whole
/// test cut (their engagement changes with the deflection, so the product does not act in proportion):
///   size_i = nominal_i + g_i(product) - d.
/// Uncertainties from the stated sigma, or from the residuals where these are larger. `no` where one factor does not
/// explain the sizes (chi-squared beyond 99 %), where they tell it to less than 50 %, where it ends beyond 1/5 to 5, or
/// where the search does not settle. Errors: MC412 fewer than three readings, or of one width alone;
/// those of predict. Cost: about ten predictions.
Result<TestCutFit> fit_test_cut(const Job& job, const TestCut& cut, const std::vector<TestCutReading>& readings,
                                const std::function<bool(double)>& progress = {});

/// The factor of all compliances of the job's machine under known forces: least squares of d = c C F over the measured
/// displacements. Errors: those of statics::computed_compliance; MA105 a machine without compliances.
Result<Factor> compliance_factor(const Job& job, const std::vector<statics::MeasuredPoint>& points);

/// What goes into the table [factors] of a job that has `old`, under which everything was foretold: the product over
/// the compliance is the factor of the forces, their relative uncertainties add as squares; without a compliance the
/// whole product is taken for the forces.
struct Separated {
  Factor force;
  Factors factors;
};
Separated separated(const Factor& product, const std::optional<Factor>& compliance, const Factors& old);

/// The text of a job file with a table [factors] at its end, in the place of the one that it may have; lines of
/// `remark` stand before it as remarks.
std::string with_factors(const std::string& job_text, const Factors& factors, const std::string& remark);

}  // namespace polypod::machining
