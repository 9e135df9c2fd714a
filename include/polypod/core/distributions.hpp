// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Tails of the distributions that tests of significance need.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

namespace polypod {

/// Regularised incomplete beta function I_x(a, b) by Lentz's continued fraction (DLMF 8.17.22); a, b > 0. To 1e-12.
inline double incomplete_beta(double a, double b, double x) {
  if (!(x > 0)) return 0;
  if (!(x < 1)) return 1;
  if (x > (a + 1) / (a + b + 2)) return 1 - incomplete_beta(b, a, 1 - x);
  constexpr double kTiny = 1e-300;
  const double front =
      std::exp(std::lgamma(a + b) - std::lgamma(a) - std::lgamma(b) + a * std::log(x) + b * std::log1p(-x)) / a;
  double c = 1, d = 1 - (a + b) * x / (a + 1);
  d = 1 / (std::abs(d) < kTiny ? kTiny : d);
  double f = d;
  for (int m = 1; m < 10000; ++m) {
    const auto step = [&](double numerator) {
      d = 1 + numerator * d;
      d = 1 / (std::abs(d) < kTiny ? kTiny : d);
      c = 1 + numerator / c;
      if (std::abs(c) < kTiny) c = kTiny;
      f *= c * d;
      return c * d;
    };
    step(m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m)));
    if (std::abs(step(-(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1))) - 1) < 1e-14) break;
  }
  return front * f;
}

/// Regularised incomplete gamma function Q(a, x) = 1 - P(a, x), by its series or its continued fraction (DLMF 8.7.1,
/// 8.9.2). To 1e-12.
inline double incomplete_gamma_above(double a, double x) {
  if (!(x > 0)) return 1;
  const double front = std::exp(a * std::log(x) - x - std::lgamma(a));
  if (x < a + 1) {
    double term = 1 / a, sum = term;
    for (int n = 1; n < 100000 && term > 1e-16 * sum; ++n) sum += term *= x / (a + n);
    return std::max(0.0, 1 - front * sum);
  }
  double b = x + 1 - a, c = 1e300, d = 1 / b, f = d;
  for (int n = 1; n < 100000; ++n) {
    const double an = n * (a - n);
    b += 2;
    d = 1 / (an * d + b);
    c = b + an / c;
    f *= c * d;
    if (std::abs(c * d - 1) < 1e-15) break;
  }
  return front * f;
}

/// How likely chance makes a value at least as large: of chi-square, F, normal (one side), and |t| (both sides).
inline double chi_square_above(double value, double degrees) {
  return incomplete_gamma_above(degrees / 2, value / 2);
}
inline double f_above(double value, double above, double below) {
  return incomplete_beta(below / 2, above / 2, below / (below + above * value));
}
inline double normal_above(double value) {
  return 0.5 * std::erfc(value / std::sqrt(2.0));
}
inline double student_both(double t, double degrees) {
  return incomplete_beta(degrees / 2, 0.5, degrees / (degrees + t * t));
}
/// The F of so many degrees of freedom above and below that chance exceeds with the probability p, by bisection of its
/// logarithm. An infinite number below is a variance that is known: chi-square over its degrees of freedom.
inline double f_quantile(double p, double above, double below) {
  const auto exceeded = [&](double f) {
    return std::isfinite(below) ? f_above(f, above, below) : chi_square_above(above * f, above);
  };
  double low = -1, high = 1;
  while (exceeded(std::exp(high)) > p && high < 500) high *= 2;
  while (exceeded(std::exp(low)) < p && low > -500) low *= 2;
  for (int k = 0; k < 100 && high - low > 1e-12; ++k) {
    const double middle = (low + high) / 2;
    (exceeded(std::exp(middle)) > p ? low : high) = middle;
  }
  return std::exp(high);
}
/// The t that |t| exceeds with the probability p, by bisection.
inline double student_quantile(double p, double degrees) {
  double low = 0, high = 1;
  while (student_both(high, degrees) > p && high < 1e9) high *= 2;
  for (int k = 0; k < 200 && high - low > 1e-12 * high; ++k) {
    const double middle = (low + high) / 2;
    (student_both(middle, degrees) > p ? low : high) = middle;
  }
  return high;
}

}  // namespace polypod
