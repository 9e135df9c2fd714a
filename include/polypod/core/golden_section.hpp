// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The least value of a function of one number.
#pragma once

namespace polypod {

/// The x in [low, high] of the least f, to `within`, where f falls and then rises (Kiefer 1953); any local least
/// otherwise. Of equal values the smaller x counts. Cost: two values of f for each factor 1.62 of high - low over
/// `within`.
template <class F>
double golden_section(F&& f, double low, double high, double within) {
  constexpr double kGolden = 0.6180339887498949;
  while (high - low > within) {
    const double a = high - kGolden * (high - low), b = low + kGolden * (high - low);
    if (f(a) <= f(b))
      high = b;
    else
      low = a;
  }
  return 0.5 * (low + high);
}

}  // namespace polypod
