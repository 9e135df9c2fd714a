// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Cutting coefficients from mean forces measured at several feeds (SLAV 5.2).
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "polypod/core/csv.hpp"
#include "polypod/cutting/force.hpp"

namespace polypod::cutting {

/// One cut and the mean force that a dynamometer showed.
struct MeasuredForce {
  CutSide side = CutSide::slot;
  double ae = 0, ap = 0, feed_per_tooth = 0;  ///< m
  Vec3 mean = Vec3::Zero();                   ///< N on the tool, in the frame of the cut: along the feed, normal, axis
  Place place;
  double sigma = 0;  ///< N, the column sigma_N: standard deviation of each of the three; 0: not said
};

/// What a file held.
struct ForceTable {
  std::vector<MeasuredForce> cuts;
  std::vector<std::string> unused_columns;
};
/// Reads the columns feed_per_tooth_mm, ap_mm, Fx_N, Fy_N, Fz_N and, if given, direction (up, down, slot; without:
/// slot), ae_mm (without: the diameter) and sigma_N. Errors: ID100 to ID103, ID106 to ID109, ID120 (a depth, feed or
/// direction out of range, a cut deeper than the edges are long).
Result<ForceTable> read_forces(const Cutter& cutter, const std::string& path, const csv::Columns& columns = {});

struct ForceOutlier {
  std::size_t row = 0;  ///< index into the measurements
  int axis = 0;         ///< 0..2
  double residual = 0;  ///< N
};

/// Forces that do not grow in proportion to the chip: with chips to the power `exponent` the residuals are smaller than
/// chance makes them (99.9 %).
struct LackOfFit {
  double exponent = 1;
  double residual_rms = 0;  ///< N, across the axis, with that exponent
  double linear_rms = 0;    ///< N, across the axis, in proportion
};

/// What a runout of the cutter does to the coefficients: how far those are away that the same forces give with it, the
/// largest over the place of the high tooth.
struct RunoutEffect {
  double reading = 0;              ///< m, total indicator reading at the edges: twice the eccentricity
  bool given = false;              ///< else supposed, and in no interval
  std::array<double, 6> change{};  ///< N/m^2 and N/m, not negative
};

/// The noise of one component of the force as the residuals show it: sigma^2 = constant^2 + (share F)^2, means over the
/// models of noise.
struct ForceNoise {
  double constant = 0;  ///< N
  double share = 0;     ///< of the force itself
};

/// The six coefficients in the order Ktc, Krc, Kac (N/m^2), Kte, Kre, Kae (N/m).
struct CuttingIdentification {
  Material material;
  std::array<double, 6> value{}, standard_error{}, half_interval{};  ///< half of the 95 % interval
  double residual_rms = 0;                                           ///< N
  std::size_t equations = 0;
  double condition = 0;         ///< of the equations with columns of unit length
  std::vector<Vec3> residuals;  ///< N, measured less computed
  std::optional<LackOfFit> lack_of_fit;
  RunoutEffect runout;
  std::array<ForceNoise, 3> noise{};  ///< of Fx, Fy, Fz
  bool noise_stated = false;          ///< each row states its sigma; `noise` then tells nothing
  double times_stated = 0;            ///< rms of residuals over sigma, per degree of freedom, where it is stated
  /// Residuals over their noise beyond 3.5 robust standard deviations of their axis, from 10 cuts on; kept.
  std::vector<ForceOutlier> outliers;
};

/// Mean forces are linear in the coefficients, F = sum_k K_k F_k with F_k = mean_force of the unit coefficient, so one
/// linear least-squares problem answers: 3 equations a cut. Tangential and radial coefficients share the two equations
/// across the axis, the axial ones have the third.
///
/// The scatter may grow with the force, and differ from component to component: sigma^2 = s^2 r (1 - w + w F^2 /
/// F_rms^2) with w from 0 (constant) to almost 1 (in proportion), r the ratio of the variances of Fy and Fx. For each
/// of 13 w and 9 r weighted least squares gives coefficients and Student's t; the residuals say how likely each is
/// (restricted likelihood, Patterson and Thompson 1971), and value, covariance and interval are those of the mixture
/// (Bayesian averaging over models, Hoeting et al. 1999; constant noise has 0.3 beforehand, equal variances 0.5). Where
/// each row states its sigma, rows count by 1 / sigma^2 alone. Standard errors have the size of the residuals in both
/// cases.
///
/// Needs two feeds at least: one alone
/// cannot tell cutting from edge coefficients. Exponent 1; whether another one explains the forces better is tested.
/// Errors: ID121 (not more equations than coefficients), ID122 (these cuts cannot tell the coefficients apart), ID123
/// (a tangential or radial coefficient below 0: is the sign or the direction wrong, or are the feeds nearly equal?),
/// ID124 (a tangential coefficient far from any metal's: a unit). `runout` (m, total indicator reading) adds to the
/// intervals and to the material's spread what it may change: teeth that miss a thin chip have no edge force, and the
/// next ones cut for them. Without it the effect of 10 um is stated, and in no interval. Cost: 0.3 ms a cut
/// and 10 ms.
Result<CuttingIdentification> identify_cutting(const Cutter& cutter, const std::vector<MeasuredForce>& rows,
                                               std::optional<double> runout = {});

/// A material file that read_material takes.
std::string to_toml(const Material& material);

}  // namespace polypod::cutting
