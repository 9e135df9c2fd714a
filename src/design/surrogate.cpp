// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "surrogate.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "refine.hpp"

namespace polypod::design {
namespace {

/// A number between two bounds by the share of their logarithms, and back.
struct Between {
  double least, most;
  [[nodiscard]] double at(double share) const { return least * std::pow(most / least, share); }
  [[nodiscard]] double share_of(double is) const {
    return std::clamp(std::log(is / least) / std::log(most / least), 0.0, 1.0);
  }
};
constexpr Between kLengths{0.03, 30};
constexpr Between kNoise{1e-7, 0.1};

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

double Kriging::set(const Shape& shape) {
  const auto n = static_cast<double>(values_.size());
  Eigen::MatrixXd R = correlations(points_, points_, shape.lengths);
  R.diagonal().setConstant(1 + shape.noise);
  correlations_.compute(R);
  if (correlations_.info() != Eigen::Success) return -std::numeric_limits<double>::infinity();
  ones_ = correlations_.solve(Eigen::VectorXd::Ones(values_.size()));
  mean_ = ones_.dot(values_) / ones_.sum();
  const Eigen::VectorXd away = values_.array() - mean_;
  weights_ = correlations_.solve(away);
  variance_ = std::max(away.dot(weights_) / n, std::numeric_limits<double>::min());
  shape_ = shape;
  const double log_det = 2 * correlations_.matrixLLT().diagonal().array().log().sum();
  // Lengths of about a range are usual, and little noise.
  constexpr double kUsual = 1, kSpread = 1.5, kNoiseSpread = 4;
  const double unusual = ((shape.lengths.array() / kUsual).log() / kSpread).square().sum() +
                         std::pow(std::log(shape.noise / kNoise.least) / kNoiseSpread, 2);
  return -0.5 * (n * std::log(variance_) + log_det + unusual);
}

void Kriging::reinterpolate() {
  noise_variance_ = shape_.noise * variance_;
  Eigen::MatrixXd R = correlations(points_, points_, shape_.lengths);
  variance_ = std::max(weights_.dot(R * weights_) / static_cast<double>(values_.size()),
                       std::numeric_limits<double>::min());       // R w are the smoothed values less their mean
  for (const double extra : {1e-10, 1e-9, 1e-8, shape_.noise}) {  // keeps R positive definite; the last has done so
    R.diagonal().setConstant(1 + extra);
    correlations_.compute(R);
    if (correlations_.info() == Eigen::Success) break;
  }
  ones_ = correlations_.solve(Eigen::VectorXd::Ones(values_.size()));
}

void Kriging::fit(const Eigen::MatrixXd& points, const Eigen::VectorXd& values, bool again) {
  points_ = points;
  values_ = values;
  if (shape_.lengths.size() != points.cols()) {
    shape_ = {Eigen::VectorXd::Ones(points.cols()), kNoise.least};
    again = true;
  }
  Shape best = shape_;
  double most = set(best);
  if (again) {
    constexpr int kCalls = 70;
    constexpr double kStep = 0.1, kNone = -1e300;
    std::vector<double> from;
    for (const double l : best.lengths) from.push_back(kLengths.share_of(l));
    from.push_back(kNoise.share_of(best.noise));
    subplex(
        from, kStep, kCalls,
        [&](const std::vector<double>& shares) {
          Shape shape{Eigen::VectorXd(points.cols()), kNoise.at(shares.back())};
          for (Eigen::Index k = 0; k < shape.lengths.size(); ++k)
            shape.lengths[k] = kLengths.at(shares[static_cast<std::size_t>(k)]);
          const double is = set(shape);
          if (is > most) {
            most = is;
            best = shape;
          }
          return std::isfinite(is) ? is : kNone;
        },
        [] { return false; });
  }
  set(best);
  reinterpolate();
}

double Kriging::noise() const {
  return std::sqrt(noise_variance_);
}

Kriging::Guess Kriging::at(const Eigen::MatrixXd& points) const {
  const Eigen::MatrixXd r = correlations(points_, points, shape_.lengths);
  Guess out;
  out.mean = (r.transpose() * weights_).array() + mean_;
  const Eigen::MatrixXd half = correlations_.matrixL().solve(r);
  const Eigen::ArrayXd told = half.colwise().squaredNorm().transpose().array();
  const Eigen::ArrayXd of_mean = (1 - (r.transpose() * ones_).array()).square() / ones_.sum();
  out.deviation = (variance_ * (1 - told + of_mean).max(0)).sqrt().matrix();
  return out;
}

}  // namespace polypod::design
