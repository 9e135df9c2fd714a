// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Numbers as a person reads them, at any scale.
#pragma once

#include <string>

namespace polypod {

/// How the figures of one kind (a table's column, the coordinates of a point) are written: all with the same decimals,
/// `usual` of them as long as the largest figure then shows `significant` digits, else as many as that takes, and never
/// more than 9 digits in all; beyond 9 decimals or 9 digits before the point with an exponent. So 12.3456 mm
/// stays 12.35, and 0.000123 mm is not 0.00.
class Figures {
 public:
  /// `largest`: of the absolute values; 0 or not finite: the usual decimals.
  explicit Figures(double largest, int usual, int significant = 3);

  /// A figure below 1e-9 of the largest is rounding: 0. "infinite" and "none" for what is no finite number.
  [[nodiscard]] std::string operator()(double value) const;
  [[nodiscard]] int decimals() const { return decimals_; }

 private:
  double largest_;
  int decimals_;
  int significant_;
  bool exponent_ = false;
};

/// One figure by itself.
std::string figure(double value, int usual, int significant = 3);

}  // namespace polypod
