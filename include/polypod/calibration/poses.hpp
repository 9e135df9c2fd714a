// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Which poses to measure: those that make the unknowns most certain, and how certain they will be.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "polypod/calibration/calibrate.hpp"
#include "polypod/calibration/simulate.hpp"
#include "polypod/calibration/site.hpp"

namespace polypod::calibration {

/// What the equations of every candidate say of the unknowns: matrices of equations x unknowns, divided by the noise,
/// with columns in units that compare (for geometry 1 % of the machine's size or 0.01 rad, for compliances their
/// nominal values).
struct Candidates {
  std::vector<Stand> stands;
  std::vector<Eigen::MatrixXd> equations;
  std::vector<std::string> unknowns;  ///< keys
  std::vector<std::string> held;      ///< keys of what no set of these poses can tell, or what follows by a rule
  std::size_t total = 0;              ///< unknowns that are looked for: of a direction's three numbers two
  std::size_t drawn = 0;              ///< stands that were drawn, those left out because of the site counted
  std::array<std::size_t, kHindrances> left_out{};  ///< of these, by why
};

/// Candidates for calibrate() with these options: `kind` as measured from `anchors` (see SimulationOptions), at stands
/// drawn as random_stands does, up to 20 times as many where the site leaves some out. Errors: CA114, CA116, CA120,
/// CA121, CA123 (the site leaves too few).
Result<Candidates> geometry_candidates(const AnyMachine& machine, std::size_t count, std::uint64_t seed, Kind kind,
                                       const std::vector<Vec3>& anchors, const CalibrationOptions& options,
                                       const Site& site = {});
/// The same at given stands, for the unknowns of `like`; without those of which nothing shows there at all.
std::vector<Eigen::MatrixXd> geometry_equations(const AnyMachine& machine, const std::vector<Stand>& stands, Kind kind,
                                                const std::vector<Vec3>& anchors, const CalibrationOptions& options,
                                                const Candidates& like);

/// Candidates for statics::identify_compliance with a force (N) along each axis and this noise of a displacement (m).
/// Errors: CA121, CA122, CA123.
Result<Candidates> compliance_candidates(const AnyMachine& machine, std::size_t count, std::uint64_t seed, double force,
                                         double noise, const Site& site = {}, const Pose& X_TR = {});
std::vector<Eigen::MatrixXd> compliance_equations(const AnyMachine& machine, const std::vector<Stand>& stands,
                                                  double force, double noise);

enum class Criterion {
  determinant,  ///< D: the volume of the uncertainty, det M greatest
  eigenvalue,   ///< E: the worst direction, the least eigenvalue of M greatest
  reading       ///< V: what the model then says for a reading, its mean variance over all candidates least
};

/// `count` different candidates whose information M = sum J_i^T J_i is greatest: greedily one after another by the gain
/// of log det M, then by exchanging one for another while the criterion grows (Fedorov 1972). The result is a local
/// optimum, the same for every run. Errors: CA130 (fewer equations than unknowns, or more poses than candidates). Cost:
/// for points about a * count * unknowns^2 * 10 operations a pass, a the candidates.
Result<std::vector<std::size_t>> choose(const std::vector<Eigen::MatrixXd>& candidates, std::size_t count,
                                        Criterion criterion);

/// What a set of equations will leave uncertain; infinite where it does not tell all unknowns.
struct Uncertainty {
  double reading = 0;  ///< standard deviation of what the model computes for an equation of `over`, over its noise
  double mean = 0;     ///< geometric mean of the axes of the uncertainty's ellipsoid, det(M)^(-1/2n), column units
  double worst = 0;    ///< its longest axis, column units
};
Uncertainty uncertainty(const std::vector<Eigen::MatrixXd>& measured, const std::vector<Eigen::MatrixXd>& over);

/// What is uncertain where one of the measured poses is lost (a reading that went wrong is seen too late): the loss
/// that makes `reading` largest, and which of `chosen` it is.
struct LostPose {
  std::size_t lost = 0;  ///< index into `chosen`
  Uncertainty left;
};
LostPose worst_loss(const std::vector<Eigen::MatrixXd>& candidates, const std::vector<std::size_t>& chosen,
                    const std::vector<Eigen::MatrixXd>& over);

/// Below this no set of as many candidates comes with Uncertainty::mean, chosen however, not even if it may hold some
/// twice: log det is concave in M, so log det M' <= log det M + N max_j trace(J_j M^-1 J_j^T) - n for every set of N
/// candidates (Kiefer and Wolfowitz 1960). 0 where an unknown is not identifiable from the set.
double least_mean(const std::vector<Eigen::MatrixXd>& candidates, const std::vector<std::size_t>& chosen);

/// `count` stands on a regular grid of places in the box of the given ones, as one would measure without a plan: the
/// tool at zero tilt (R = 1) and tilted by `tilt` (rad) to four sides in turn. Fewer where the machine reaches fewer.
std::vector<Stand> grid_stands(const AnyMachine& machine, const std::vector<Stand>& box, std::size_t count,
                               double tilt);

}  // namespace polypod::calibration
