// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "surrogate.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "refine.hpp"

namespace polypod::design {
namespace {

constexpr double kShortest = 0.03, kLongest = 30;
constexpr double kNugget = 1e-7;  // of the variance: figures are means over samples, and no smooth functions

double length_at(double share) {
  return kShortest * std::pow(kLongest / kShortest, share);
}
double share_of(double length) {
  return std::clamp(std::log(length / kShortest) / std::log(kLongest / kShortest), 0.0, 1.0);
}

Eigen::MatrixXd correlations(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b, const Eigen::VectorXd& lengths) {
  const Eigen::RowVectorXd scale = lengths.cwiseInverse().transpose();
  const Eigen::MatrixXd A = a.array().rowwise() * scale.array(), B = b.array().rowwise() * scale.array();
  Eigen::MatrixXd r2 = -2 * A * B.transpose();
  r2.colwise() += A.rowwise().squaredNorm();
  r2.rowwise() += B.rowwise().squaredNorm().transpose();
  const double root5 = std::sqrt(5.0);
  const Eigen::ArrayXXd r = r2.array().max(0).sqrt();
  return ((1 + root5 * r + 5.0 / 3 * r.square()) * (-root5 * r).exp()).matrix();
}

}  // namespace

double Kriging::set(const Eigen::VectorXd& lengths) {
  const auto n = static_cast<double>(values_.size());
  Eigen::MatrixXd R = correlations(points_, points_, lengths);
  R.diagonal().setConstant(1 + kNugget);
  correlations_.compute(R);
  if (correlations_.info() != Eigen::Success) return -std::numeric_limits<double>::infinity();
  ones_ = correlations_.solve(Eigen::VectorXd::Ones(values_.size()));
  mean_ = ones_.dot(values_) / ones_.sum();
  const Eigen::VectorXd away = values_.array() - mean_;
  weights_ = correlations_.solve(away);
  variance_ = std::max(away.dot(weights_) / n, std::numeric_limits<double>::min());
  lengths_ = lengths;
  const double log_det = 2 * correlations_.matrixLLT().diagonal().array().log().sum();
  // Lengths of about a range are usual.
  constexpr double kUsual = 1, kSpread = 1.5;
  const double unusual = ((lengths.array() / kUsual).log() / kSpread).square().sum();
  return -0.5 * (n * std::log(variance_) + log_det + unusual);
}

void Kriging::fit(const Eigen::MatrixXd& points, const Eigen::VectorXd& values, bool again) {
  points_ = points;
  values_ = values;
  if (lengths_.size() != points.cols()) {
    lengths_ = Eigen::VectorXd::Ones(points.cols());
    again = true;
  }
  Eigen::VectorXd best = lengths_;
  double most = set(lengths_);
  if (again) {
    constexpr int kCalls = 60;
    constexpr double kStep = 0.1, kNone = -1e300;
    std::vector<double> from;
    for (const double l : best) from.push_back(share_of(l));
    subplex(
        from, kStep, kCalls,
        [&](const std::vector<double>& shares) {
          Eigen::VectorXd lengths(points.cols());
          for (Eigen::Index k = 0; k < lengths.size(); ++k) lengths[k] = length_at(shares[static_cast<std::size_t>(k)]);
          const double is = set(lengths);
          if (is > most) {
            most = is;
            best = lengths;
          }
          return std::isfinite(is) ? is : kNone;
        },
        [] { return false; });
  }
  set(best);
}

Kriging::Guess Kriging::at(const Eigen::MatrixXd& points) const {
  const Eigen::MatrixXd r = correlations(points_, points, lengths_);
  Guess out;
  out.mean = (r.transpose() * weights_).array() + mean_;
  const Eigen::MatrixXd half = correlations_.matrixL().solve(r);
  const Eigen::ArrayXd told = half.colwise().squaredNorm().transpose().array();
  const Eigen::ArrayXd of_mean = (1 - (r.transpose() * ones_).array()).square() / ones_.sum();
  out.deviation = (variance_ * (1 + kNugget - told + of_mean).max(0)).sqrt().matrix();
  return out;
}

}  // namespace polypod::design
