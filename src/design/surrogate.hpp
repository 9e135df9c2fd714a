// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A model of a figure of dear candidates, from those that were judged.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>

namespace polypod::design {

/// Kriging with a constant mean (Jones, Schonlau, Welch 1998): a Gaussian process over [0, 1]^n whose correlation is
/// Matern's with nu = 5/2 and a length for each parameter,
///   R(a, b) = (1 + sqrt 5 r + 5/3 r^2) exp(-sqrt 5 r), r^2 = sum ((a_k - b_k) / l_k)^2.
/// The lengths make the values most likely, with a wide prior; mean and variance follow in closed form. Deterministic.
/// Cost: n_points^3 / 3 a fit with known lengths, some hundred times that with new ones.
class Kriging {
 public:
  struct Guess {
    Eigen::VectorXd mean, deviation;  ///< one a point
  };

  /// `points`: a row each. `again`: look for the lengths anew, from those of before.
  void fit(const Eigen::MatrixXd& points, const Eigen::VectorXd& values, bool again);
  /// What is thought of other points; the deviation is that of the process, 0 at points that are known.
  [[nodiscard]] Guess at(const Eigen::MatrixXd& points) const;
  [[nodiscard]] const Eigen::VectorXd& lengths() const { return lengths_; }

 private:
  /// Decomposes the correlations for these lengths; the logarithm of the likelihood but for a constant.
  double set(const Eigen::VectorXd& lengths);

  Eigen::MatrixXd points_;
  Eigen::VectorXd values_, lengths_, weights_, ones_;  ///< R^-1 (y - mean), R^-1 1
  Eigen::LLT<Eigen::MatrixXd> correlations_;
  double mean_ = 0, variance_ = 0;
};

}  // namespace polypod::design
