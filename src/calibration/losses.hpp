// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Robust losses of whitened residuals.
#pragma once

#include <algorithm>
#include <cmath>

#include "polypod/calibration/calibrate.hpp"

namespace polypod::calibration {

/// Where a robust loss begins to bend for rows of n equations, in standard deviations: beyond what normal noise does.
inline double bend_of(int n) {
  return std::sqrt(double(n)) + 2;
}
inline double outlier_of(int n) {
  return std::sqrt(double(n)) + 3;
}

inline double weight_of(Loss loss, double bend, double squared_norm) {
  if (loss == Loss::huber || loss == Loss::automatic)
    return std::min(1.0, bend / std::sqrt(std::max(squared_norm, 1e-300)));
  if (loss == Loss::cauchy) return 1 / (1 + squared_norm / (bend * bend));
  return 1;
}

}  // namespace polypod::calibration
