// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the uncertainty of a machine's compliances and of its calibrated parameters means for a program.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "polypod/machining/correct.hpp"

namespace polypod::machining {

/// U (k = 2) of the deflection along a program, from the covariance of the compliances, m.
struct ComplianceBand {
  Spread normal;  ///< of the normal error
  /// Across the path: along the normal and along the tool axis, in that direction of the two in which it is largest (on
  /// a plunge, which has no normal, in space). It counts against the tube.
  Spread across;
  /// The largest `across` on each of Prediction::moves; where none of the points lies on a move, the largest of all.
  std::vector<double> by_move;
};

/// Over `prediction.few`, under its forces F and at its poses: delta = sum_k c_k J_k J_k^T F is linear in the
/// compliances c (to first order for deltas of four arms, which share their load), so that its covariance is G S G^T
/// with the columns G_k = J_k J_k^T F. That another deflection changes the force is left out, as in map_band: the
/// balance makes U a little smaller. `covariance`: SI, in the order of statics::column_names. `source` leads from the
/// moves of the pass to those of the program, as Correction::source; null where they are the same. Cost: 10 us a point
/// for an arm.
ComplianceBand compliance_band(const Job& job, const Prediction& prediction, const Eigen::MatrixXd& covariance,
                               const LongVector<int>* source = nullptr);

/// U (k = 2) of the tip's place, in the direction in which it is largest, from the covariance of the machine's
/// parameters, m. The tube is not compared with it, but with the deflection alone.
struct PlaceBand {
  Spread tip;
  int line = 0;  ///< of the program, where it is largest
};
/// Over `prediction.few`. `covariance`: SI, in the order of kinematics::parameters. `source` as above. Cost: 50 us a
/// point.
PlaceBand place_band(const Job& job, const Prediction& prediction, const Eigen::MatrixXd& covariance,
                     const LongVector<int>* source = nullptr);

/// The move that comes farthest from its programmed path when U is added to what is found of it.
struct Reach {
  bool within = false;  ///< the answer without U is yes, and no move comes with U beyond the tube
  int line = 0;
  double distance = 0;  ///< m, that was found, the controller's corners counted
  double U = 0;         ///< m, of the compliances there

  [[nodiscard]] double total() const { return distance + U; }
  /// "at line 30", or that it is the program with the other switch.
  [[nodiscard]] std::string where() const;
};

/// What a program is told of these uncertainties; empty where no covariance was given or no point cuts.
struct Uncertainty {
  std::optional<ComplianceBand> compliances;
  std::optional<Reach> reach;  ///< with `compliances`
  std::optional<PlaceBand> place;
};
/// Covariances as above; null: not known.
Uncertainty uncertainty_of(const Job& job, const Prediction& prediction, const Eigen::MatrixXd* compliances,
                           const Eigen::MatrixXd* parameters);
/// Of the corrected program.
Uncertainty uncertainty_of(const Job& job, const Correction& correction, const Eigen::MatrixXd* compliances,
                           const Eigen::MatrixXd* parameters);

}  // namespace polypod::machining
