// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Kriging models against functions that are known.
#include "../../src/design/surrogate.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "polypod/core/random.hpp"

namespace polypod::design {
namespace {

Eigen::MatrixXd random_points(int count, int n, std::uint64_t seed) {
  Random random(seed);
  Eigen::MatrixXd out(count, n);
  for (int i = 0; i < count; ++i)
    for (int k = 0; k < n; ++k) out(i, k) = random.uniform();
  return out;
}
double smooth(const Eigen::VectorXd& u) {
  return std::sin(3 * u[0]) + u[1] * u[1] - 0.5 * u[0] * u[2];
}
Eigen::VectorXd values_of(const Eigen::MatrixXd& points) {
  Eigen::VectorXd out(points.rows());
  for (Eigen::Index i = 0; i < out.size(); ++i) out[i] = smooth(points.row(i).transpose());
  return out;
}

TEST(Kriging, GoesThroughWhatIsKnown) {
  const Eigen::MatrixXd points = random_points(30, 3, 1);
  const Eigen::VectorXd values = values_of(points);
  Kriging model;
  model.fit(points, values, true);
  const Kriging::Guess guess = model.at(points);
  EXPECT_LT((guess.mean - values).cwiseAbs().maxCoeff(), 1e-3);  // the values spread by 0.4
  EXPECT_LT(guess.deviation.maxCoeff(), 2e-3);
}

TEST(Kriging, ForetellsASmoothFunctionWithinItsDeviation) {
  const Eigen::MatrixXd points = random_points(60, 3, 2), others = random_points(500, 3, 3);
  Kriging model;
  model.fit(points, values_of(points), true);
  const Kriging::Guess guess = model.at(others);
  const Eigen::VectorXd off = guess.mean - values_of(others);
  EXPECT_LT(std::sqrt(off.squaredNorm() / 500), 0.02);  // the values spread by 0.4
  int within = 0;
  for (int i = 0; i < 500; ++i) within += std::abs(off[i]) < 2 * guess.deviation[i] ? 1 : 0;
  EXPECT_GT(within, 425);
}

/// A parameter that does nothing gets a length far above that of the others.
TEST(Kriging, FindsWhatDoesNotMatter) {
  const Eigen::MatrixXd points = random_points(50, 2, 4);
  Eigen::VectorXd values(50);
  for (int i = 0; i < 50; ++i) values[i] = std::sin(6 * points(i, 0));
  Kriging model;
  model.fit(points, values, true);
  EXPECT_GT(model.lengths()[1], 5 * model.lengths()[0]);
}

/// Of two points the mean is their mean and the weights follow by hand: R = [[1, r], [r, 1]], and g by the
/// deviation of the noise s: s^2 = g / (1 + g - r).
TEST(Kriging, OfTwoPointsByHand) {
  Eigen::MatrixXd points(2, 1);
  points << 0.2, 0.8;
  Kriging model;
  model.fit(points, Eigen::Vector2d(1, 3), true);
  Eigen::MatrixXd middle(1, 1);
  middle << 0.5;
  const Kriging::Guess guess = model.at(middle);
  EXPECT_NEAR(guess.mean[0], 2, 1e-6);
  const double l = model.lengths()[0];
  const auto R = [&](double apart) {
    const double x = std::sqrt(5.0) * apart / l;
    return (1 + x + x * x / 3) * std::exp(-x);
  };
  const double r = R(0.6), k = R(0.3), s2 = model.noise() * model.noise(), g = s2 * (1 - r) / (1 - s2);
  const double variance = (1 - r) / std::pow(1 + g - r, 2);  // w^T R w / 2, w = (R + g I)^-1 (y - 2)
  const double told = 2 * k * k / (1 + r), of_mean = std::pow(1 - 2 * k / (1 + r), 2) * (1 + r) / 2;
  EXPECT_NEAR(guess.deviation[0], std::sqrt(variance * (1 - told + of_mean)), 1e-4 * guess.deviation[0]);
}

/// Noise on the values is found and smoothed away: the mean is nearer to the function than the values are, and where
/// values are known nothing more is expected.
TEST(Kriging, FindsTheNoiseAndSmoothsIt) {
  constexpr double kNoise = 0.02;
  const Eigen::MatrixXd points = random_points(120, 3, 7), others = random_points(500, 3, 8);
  Eigen::VectorXd values = values_of(points);
  Random random(9);
  for (double& y : values) y += kNoise * random.normal();
  Kriging model;
  model.fit(points, values, true);
  EXPECT_GT(model.noise(), 0.7 * kNoise);
  EXPECT_LT(model.noise(), 1.4 * kNoise);
  const Kriging::Guess known = model.at(points), elsewhere = model.at(others);
  EXPECT_LT((known.mean - values_of(points)).norm(), 0.6 * (values - values_of(points)).norm());
  EXPECT_LT(known.deviation.maxCoeff(), 1e-3) << elsewhere.deviation.minCoeff();
  EXPECT_LT((elsewhere.mean - values_of(others)).norm() / std::sqrt(500), 0.75 * kNoise);
  EXPECT_GT(elsewhere.deviation.minCoeff(), 0);
}

/// Of smooth values there is none.
TEST(Kriging, FindsNoNoiseWhereThereIsNone) {
  const Eigen::MatrixXd points = random_points(60, 3, 10);
  Kriging model;
  model.fit(points, values_of(points), true);
  EXPECT_LT(model.noise(), 2e-3);  // the values spread by 0.4
}

TEST(Kriging, TakesValuesThatAreAllAlike) {
  const Eigen::MatrixXd points = random_points(10, 2, 5);
  Kriging model;
  model.fit(points, Eigen::VectorXd::Constant(10, 4.0), true);
  const Kriging::Guess guess = model.at(random_points(20, 2, 6));
  EXPECT_LT((guess.mean.array() - 4).abs().maxCoeff(), 1e-9);
  EXPECT_TRUE(guess.deviation.allFinite());
}

}  // namespace
}  // namespace polypod::design
