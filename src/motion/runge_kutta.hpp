// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// One step of a Runge-Kutta method.
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>

namespace polypod::motion {

struct RungeKuttaStep {
  Eigen::VectorXd y;      ///< at t + h, of fifth order
  Eigen::VectorXd error;  ///< less the result of fourth order
};

/// A step h of y' = f(t, y) by the pair of fifth and fourth order of Dormand and Prince (J. R. Dormand, P. J. Prince,
/// "A family of embedded Runge-Kutta formulae", Journal of Computational and Applied Mathematics 6 (1980) 19-26), from
/// f(t, y) = `slope` on. `f` gives std::optional<VectorXd>: nothing where it has no value, and then there is no step.
template <class F>
std::optional<RungeKuttaStep> dormand_prince(F&& f, double t, const Eigen::VectorXd& y, const Eigen::VectorXd& slope,
                                             double h) {
  constexpr int kStages = 7;
  constexpr std::array<double, kStages> kTime{0, 1.0 / 5, 3.0 / 10, 4.0 / 5, 8.0 / 9, 1, 1};
  constexpr std::array<std::array<double, 6>, kStages> kStage{{
      {},
      {1.0 / 5},
      {3.0 / 40, 9.0 / 40},
      {44.0 / 45, -56.0 / 15, 32.0 / 9},
      {19372.0 / 6561, -25360.0 / 2187, 64448.0 / 6561, -212.0 / 729},
      {9017.0 / 3168, -355.0 / 33, 46732.0 / 5247, 49.0 / 176, -5103.0 / 18656},
      {35.0 / 384, 0, 500.0 / 1113, 125.0 / 192, -2187.0 / 6784, 11.0 / 84},
  }};
  constexpr std::array<double, kStages> kFourth{5179.0 / 57600, 0,       7571.0 / 16695, 393.0 / 640, -92097.0 / 339200,
                                                187.0 / 2100,   1.0 / 40};
  std::array<Eigen::VectorXd, kStages> k;
  k[0] = slope;
  Eigen::VectorXd at;
  for (std::size_t stage = 1; stage < kStages; ++stage) {
    at = y;
    for (std::size_t j = 0; j < stage; ++j)
      if (kStage[stage][j] != 0) at += h * kStage[stage][j] * k[j];
    std::optional<Eigen::VectorXd> value = f(t + h * kTime[stage], at);
    if (!value) return std::nullopt;
    k[stage] = std::move(*value);
  }
  // The last stage stands at the result of fifth order.
  Eigen::VectorXd fourth = y;
  for (std::size_t j = 0; j < kStages; ++j) fourth += h * kFourth[j] * k[j];
  return RungeKuttaStep{at, at - fourth};
}

}  // namespace polypod::motion
