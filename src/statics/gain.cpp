// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/statics/gain.hpp"

#include <algorithm>
#include <cmath>

#include "polypod/core/statistics.hpp"

namespace polypod::statics {

GainEffect add_gain(Identification& r, double relative) {
  constexpr double kOneSided = 1.6448536269514722;  // 95 %, normal
  constexpr double kNoEnd = 1e9;
  const double free = std::max(1.0, double(r.equations) - double(r.compliance.size()));
  Eigen::VectorXd c = Eigen::Map<const Eigen::VectorXd>(r.compliance.data(), std::ssize(r.compliance));
  for (std::size_t k = 0; k < r.told.size(); ++k)
    if (!r.told[k]) c[static_cast<Eigen::Index>(k)] = 0;  // not of these readings
  r.covariance += relative * relative * c * c.transpose();
  GainEffect out{relative, r.standard_error, {}, {}};
  for (std::size_t i = 0; i < r.compliance.size(); ++i) {
    const double readings = r.standard_error[i], gain = std::abs(r.compliance[i]) * relative;
    const double both = std::hypot(readings, gain);
    out.standard_error_gain.push_back(gain);
    const double degrees = readings > 0 ? free * std::pow(both / readings, 4) : kNoEnd;
    out.degrees.push_back(degrees < kNoEnd ? degrees : 0);
    r.standard_error[i] = both;
    r.half_interval[i] = student_95(std::min(degrees, kNoEnd)) * both;
    if (r.upper_bound[i]) *r.upper_bound[i] *= 1 + kOneSided * relative;
  }
  return out;
}

}  // namespace polypod::statics
