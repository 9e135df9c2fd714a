// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/core/range_text.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace polypod::config {
namespace {

constexpr std::array<std::string_view, 23> kUnits{"m",   "cm",   "mm",  "um", "mm2", "mm3", "in",     "deg",
                                                  "rad", "mrad", "N",   "kN", "Nm",  "K",   "C",      "s",
                                                  "s2",  "ms",   "min", "kg", "Hz",  "MB",  "percent"};

bool is_unit(std::string_view part) {
  return std::find(kUnits.begin(), kUnits.end(), part) != kUnits.end();
}

std::string shown(std::string_view unit) {
  return unit == "C" ? "deg C" : unit == "percent" ? "%" : std::string(unit);
}

/// Units that stand side by side: "m K".
std::string product(const std::vector<std::string_view>& units) {
  std::string out;
  for (const std::string_view unit : units) out += (out.empty() ? "" : " ") + shown(unit);
  return out;
}

}  // namespace

std::string in_words(const Range& range, std::string_view unit) {
  const bool low = std::isfinite(range.min), high = std::isfinite(range.max);
  if (!low && !high) return "finite";
  std::string out;
  if (low) out = fmt::format("{} {:g}", range.open_min ? "greater than" : "at least", range.min);
  if (low && high) out += " and ";
  if (high) out += fmt::format("{} {:g}", range.open_max ? "less than" : "at most", range.max);
  return unit.empty() ? out : fmt::format("{} {}", out, unit);
}

std::string unit_of(std::string_view key) {
  while (key.ends_with(']')) key = key.substr(0, std::min(key.rfind('['), key.size() - 1));
  key = key.substr(key.rfind('.') + 1);
  std::vector<std::string_view> over, under;  // read from the end
  bool per = false;
  for (std::size_t end = key.size(); end > 0 && end != std::string_view::npos;) {
    const std::size_t bar = key.rfind('_', end - 1);
    if (bar == std::string_view::npos && !(per && over.empty()))
      break;  // the first part is the name, but for rad_per_Nm
    const std::string_view part = key.substr(bar + 1, end - bar - 1);
    if (part == "per" && !per && !over.empty()) {
      per = true;
      std::swap(over, under);
    } else if (is_unit(part)) {
      over.insert(over.begin(), part);
    } else {
      break;
    }
    end = bar;
  }
  if (per && over.empty()) {  // feed_per_tooth_mm has a unit, and "per" is part of its name
    std::swap(over, under);
    per = false;
  }
  if (!per) return over.empty() ? "" : shown(over.back());
  return product(over) + (under.size() > 1 ? "/(" + product(under) + ")" : "/" + product(under));
}

}  // namespace polypod::config
