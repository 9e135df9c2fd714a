// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What an uncertain gain of forces or displacements does to identified compliances (GUM type B).
#pragma once

#include <vector>

#include "polypod/statics/identify.hpp"

namespace polypod::statics {

/// What the gain added, and what the readings alone say.
struct GainEffect {
  double relative = 0;                          ///< standard uncertainty of the gain, 1
  std::vector<double> standard_error_readings;  ///< of each compliance, without the gain
  std::vector<double> standard_error_gain;      ///< |c| times the gain's
  std::vector<double> degrees;  ///< effective degrees of freedom (Welch, Satterthwaite); 0: no end of them
};
/// All displacements are proportional to the compliances and to the forces, so that with a force gain of 1 + g every
/// compliance is found 1 + g times too large: an error common to all that residuals do not show. Its standard deviation
/// `relative` (above 0) goes into standard_error (in squares), into half_interval with Student's t of the effective
/// degrees of freedom, into upper_bound (1.645 standard deviations of it), and into covariance as relative^2 c c^T.
/// `correlation` and `hardly_apart` stay
/// those of the readings: which joints the poses tell apart.
GainEffect add_gain(Identification& r, double relative);

}  // namespace polypod::statics
