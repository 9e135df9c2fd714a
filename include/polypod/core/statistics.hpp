// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Numbers of statistics that several modules need.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace polypod {

/// Two-sided 95 % quantile of Student's t with n >= 1 degrees of freedom: up to 10 that of tables, linear in 1/n
/// between whole numbers, else Cornish-Fisher in 1/n to third order (within 1e-4 of it).
inline double student_95(double n) {
  constexpr std::array kTable{12.7062, 4.3027, 3.1824, 2.7764, 2.5706, 2.4469, 2.3646, 2.3060, 2.2622, 2.2281};
  if (n < static_cast<double>(kTable.size())) {
    const double whole = std::floor(std::max(1.0, n)), next = whole + 1;
    const double low = kTable[static_cast<std::size_t>(whole) - 1], high = kTable[static_cast<std::size_t>(whole)];
    return low + (high - low) * (1 / whole - 1 / std::max(1.0, n)) / (1 / whole - 1 / next);
  }
  constexpr double z = 1.959963984540054;
  const double z3 = z * z * z, z5 = z3 * z * z, z7 = z5 * z * z;
  return z + (z3 + z) / (4 * n) + (5 * z5 + 16 * z3 + 3 * z) / (96 * n * n) +
         (3 * z7 + 19 * z5 + 17 * z3 - 15 * z) / (384 * n * n * n);
}

/// 1.4826 times the median of |r|: the standard deviation of normal residuals, whatever a few outliers do.
inline double robust_deviation(const Eigen::VectorXd& r) {
  constexpr double kNormalPerMad = 1.4826;
  if (r.size() == 0) return 0;
  std::vector<double> sizes(static_cast<std::size_t>(r.size()));
  for (std::size_t i = 0; i < sizes.size(); ++i) sizes[i] = std::abs(r[static_cast<Eigen::Index>(i)]);
  const auto middle = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2);
  std::nth_element(sizes.begin(), middle, sizes.end());
  return kNormalPerMad * *middle;
}

}  // namespace polypod
