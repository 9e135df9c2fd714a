// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/core/figures.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace polypod {

Figures::Figures(double largest, int usual, int significant)
    : largest_(std::isfinite(largest) ? std::abs(largest) : 0), decimals_(usual), significant_(significant) {
  constexpr int kMostDecimals = 9, kMostDigits = 9;  // more than a computed figure holds
  constexpr double kMostBefore = 1e9;
  if (largest_ == 0) return;
  const int power = static_cast<int>(std::floor(std::log10(largest_))), needed = significant - 1 - power;
  if (needed > usual) decimals_ = needed;
  decimals_ = std::clamp(kMostDigits - 1 - power, 0, decimals_);
  exponent_ = needed > std::max(usual, kMostDecimals) || largest_ >= kMostBefore;
}

std::string Figures::operator()(double value) const {
  constexpr double kRounding = 1e-9;
  if (std::isnan(value)) return "none";
  if (std::isinf(value)) return value > 0 ? "infinite" : "-infinite";
  if (std::abs(value) < kRounding * largest_) value = 0;
  if (exponent_) return value == 0 ? "0" : fmt::format("{:.{}e}", value, significant_ - 1);
  std::string out = fmt::format("{:.{}f}", value, decimals_);
  if (out[0] == '-' && out.find_first_not_of("-0.") == std::string::npos) out.erase(0, 1);  // a zero without its sign
  return out;
}

std::string figure(double value, int usual, int significant) {
  return Figures(value, usual, significant)(value);
}

}  // namespace polypod
