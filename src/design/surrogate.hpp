// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A model of a figure of dear candidates, from those that were judged.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>

namespace polypod::design {

/// Kriging with a constant mean (Jones, Schonlau, Welch 1998): a Gaussian process over [0, 1]^n whose correlation is
/// Matern's with nu = 5/2 and a length for each parameter,
///   R(a, b) = (1 + sqrt 5 r + 5/3 r^2) exp(-sqrt 5 r), r^2 = sum ((a_k - b_k) / l_k)^2,
/// and values with noise of the variance g times that of the process: y ~ N(mu 1, sigma^2 (R + g I)). Figures that are
/// means over samples have such noise. Lengths and g make the values most likely, with wide priors; mean and variance
/// follow in closed form. A value comes out the same again, noise and all, so what is not known is taken of the process
/// through the smoothed values (reinterpolation, Forrester, Keane, Bressloff 2006): nothing is gained at known points.
/// Deterministic. Cost: 2/3 n_points^3 a fit with known lengths, some fifty times that with new ones.
class Kriging {
 public:
  struct Guess {
    Eigen::VectorXd mean, deviation;  ///< one a point
  };

  /// `points`: a row each. `again`: look for the lengths and the noise anew, from those of before.
  void fit(const Eigen::MatrixXd& points, const Eigen::VectorXd& values, bool again);
  /// What is thought of other points without their noise; the deviation is 0 at points that are known.
  [[nodiscard]] Guess at(const Eigen::MatrixXd& points) const;
  [[nodiscard]] const Eigen::VectorXd& lengths() const { return shape_.lengths; }
  /// The deviation of the noise, in units of the values.
  [[nodiscard]] double noise() const;

 private:
  struct Shape {
    Eigen::VectorXd lengths;
    double noise;  ///< g
  };
  /// Decomposes R + g I and has mean, variance and weights by it; the logarithm of the likelihood times the priors but
  /// for a constant, -infinity where the decomposition fails.
  double set(const Shape& shape);
  /// The same of the process through the smoothed values.
  void reinterpolate();

  Eigen::MatrixXd points_;
  Eigen::VectorXd values_, weights_, ones_;  ///< (R + g I)^-1 (y - mean), of the smoothed values R^-1 1
  Shape shape_;
  Eigen::LLT<Eigen::MatrixXd> correlations_;
  double mean_ = 0, variance_ = 0, noise_variance_ = 0;
};

}  // namespace polypod::design
