// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The share of a box that lies in a half space.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "polypod/geometry/pose.hpp"

namespace polypod::workspace {

/// The share of the box |x_k| <= half_k with m + G . x >= 0, as a bound: never above the true share if `below`, never
/// under it otherwise. Components of G that matter less than 1e-4 of the largest are given to m against the share (the
/// formula divides by them). The exact share of the rest: with a_k = |G_k| half_k and s = m + sum a_k the simplex
/// formula sum over subsets (-1)^|K| max(0, s - 2 sum_K a_k)^3 / (48 a_1 a_2 a_3), with fewer factors in fewer
/// dimensions.
inline double share_in_half_space(double m, const Vec3& G, const Vec3& half, bool below) {
  const std::array<double, 3> all{std::abs(G[0]) * half[0], std::abs(G[1]) * half[1], std::abs(G[2]) * half[2]};
  const double sum = all[0] + all[1] + all[2];
  if (m >= sum) return 1;
  if (m <= -sum) return 0;
  const double largest = std::max({all[0], all[1], all[2]});
  std::array<double, 3> a{};
  int n = 0;
  double s = m;
  for (const double x : all) {
    if (x > 1e-4 * largest) {
      a[static_cast<std::size_t>(n++)] = x;
      s += x;
    } else {
      s += below ? -x : x;
    }
  }
  double share = 0, divisor = 1;
  for (int k = 0; k < n; ++k) divisor *= 2 * a[static_cast<std::size_t>(k)] * (k + 1);
  for (unsigned subset = 0; subset < (1U << n); ++subset) {
    double t = s, sign = 1;
    for (int k = 0; k < n; ++k) {
      if ((subset >> k & 1U) == 0) continue;
      t -= 2 * a[static_cast<std::size_t>(k)];
      sign = -sign;
    }
    if (t <= 0) continue;
    double power = t;
    for (int k = 1; k < n; ++k) power *= t;
    share += sign * power;
  }
  share /= divisor;
  // Cancellation in the sum: at most some 1e-16 * (6 / 1e-8) of the whole.
  constexpr double kRounding = 1e-7;
  return std::clamp(below ? share - kRounding : share + kRounding, 0.0, 1.0);
}

}  // namespace polypod::workspace
