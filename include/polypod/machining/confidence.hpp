// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How likely the walls of a corrected program are inside the tube, and which input should be known better.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <string>
#include <vector>

#include "polypod/machining/correct.hpp"

namespace polypod::machining {

/// Something that is not known exactly.
struct UncertainInput {
  std::string name;  ///< "compliance of joint 2", "cutting coefficients, mostly Ktc"
  double share = 0;  ///< of the variance of the normal error, a mean over the walls
  /// The least probability of a wall if this one were known twice as well.
  double least_if_halved = 0;
};

/// The side of a programmed move that is cut.
struct WallConfidence {
  int line = 0;
  double low = 0, high = 0;  ///< m, ends of the 95 % band: the normal error found, and 1.96 sd of its shift
  double sd = 0;             ///< m, the largest of its points
  double room = 0;  ///< m, what the tube leaves across the path where the wall is nearest to its end: less the error
                    ///< along the tool, and at a corner less what the controller rounds
  double probability = 0;        ///< that all of it is inside
  std::vector<double> by_input;  ///< m^2, the variance that each input makes; below 0 where inputs cancel
};

struct Confidence {
  std::vector<WallConfidence> walls;   ///< of moves that cut and have a side
  std::vector<UncertainInput> inputs;  ///< those that make the most first
  double least = 1;                    ///< the smallest probability of a wall
  int line = 0;                        ///< its line
  int draws = 0;                       ///< that the probabilities are shares of

  /// A share of the draws with no more digits than they hold: "more than 99.9 %" where all of them are inside.
  [[nodiscard]] std::string percent(double probability) const;
};

/// Shifts of the walls of a corrected program by the compliances' covariance S (SI, in the order of
/// statics::column_names; empty: exact) and by the variations of the cutting coefficients (Material::spread, each half
/// of a 95 % interval: 1.96 sd), taken as normal and independent of each other.
///
/// The error of a point across the path is e + g^T c + sum_v sd_v x_v: e as it was found, g_k = n^T J_k J_k^T F
/// (compliance_band) with the drawn compliances c, and for each variation the change of the wall's mean normal error
/// when it goes through the whole program once more. The error along the tool goes the same way, with the tool's axis
/// in the place of n and the same draws; of a plunge it does not count. A wall is inside where both together are at all
/// of its points; the probability is the share of 4096 draws, the same in every call: its standard error is sqrt(p (1 -
/// p) / 4096), and of 1 or 0 it says no more than that all or none were inside (95 %: beyond 0.9993). Points: some of
/// each wall at equal distances, and the farthest both ways. Left out: that another deflection changes the force (S a
/// little too wide), the machine's geometry, and everything that the model leaves out. Cost: a pass, one more a
/// variation, and 10 us a point for an arm. Errors: those of run_pass; MC310 a wall is not found, as with a variation;
/// MC311.
Result<Confidence> confidence_of(const Job& job, const gcode::Program& program, const Correction& correction,
                                 const Eigen::MatrixXd& covariance, const std::function<bool(double)>& progress = {});

/// Error: MC311 where the 95 % interval of the material's tangential coefficient holds 0: then what a variation changes
/// is not in proportion to it.
Status force_is_known(const Job& job);

}  // namespace polypod::machining
