// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Numbers as `printf("%.4f")` prints them, digit for digit, in a tenth of its time: canonical text is little else.
#pragma once

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <string>

namespace polypod::gcode {

inline void append_whole(std::string& out, std::uint64_t n) {
  std::array<char, 20> digits;
  std::size_t at = digits.size();
  do {
    digits[--at] = static_cast<char>('0' + n % 10);
    n /= 10;
  } while (n > 0);
  out.append(digits.data() + at, digits.size() - at);
}

/// Four decimals, correctly rounded; a negative zero keeps its sign.
inline void append_fixed(std::string& out, double value) {
  // Ten thousand times the value is off by less than kNear there, so only a rest that is that near to one half needs
  // the exact decimals.
  constexpr double kMost = 1e11, kNear = 1e-4;
  const double scaled = std::abs(value) * 1e4, whole = std::floor(scaled), rest = scaled - whole;
  if (!(scaled < kMost) || std::abs(rest - 0.5) < kNear) {
    fmt::format_to(std::back_inserter(out), "{:.4f}", value);
    return;
  }
  const std::uint64_t n = static_cast<std::uint64_t>(whole) + (rest > 0.5 ? 1 : 0), decimals = n % 10000;
  if (std::signbit(value)) out += '-';
  append_whole(out, n / 10000);
  const std::array<char, 5> text{'.', static_cast<char>('0' + decimals / 1000),
                                 static_cast<char>('0' + decimals / 100 % 10),
                                 static_cast<char>('0' + decimals / 10 % 10), static_cast<char>('0' + decimals % 10)};
  out.append(text.data(), text.size());
}

}  // namespace polypod::gcode
