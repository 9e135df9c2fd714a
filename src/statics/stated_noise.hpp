// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The noise that a file of displacements states.
#pragma once

#include <cmath>
#include <vector>

#include "polypod/statics/identify.hpp"

namespace polypod::statics {

/// Root of the mean square of sigma, m; 0 where not every row states one. Rows count by this over their own.
inline double stated_noise(const std::vector<MeasuredPoint>& points) {
  double sum = 0;
  for (const MeasuredPoint& p : points) {
    if (!(p.sigma > 0)) return 0;
    sum += p.sigma * p.sigma;
  }
  return points.empty() ? 0 : std::sqrt(sum / double(points.size()));
}

}  // namespace polypod::statics
