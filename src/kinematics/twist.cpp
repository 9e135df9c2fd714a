// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/kinematics/twist.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace polypod::kinematics {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;

}  // namespace

Pose twisted(const Pose& X_MT, double gamma) {
  return {X_MT.R * rotation_z(gamma), X_MT.p};
}

std::vector<TwistRange> twist_ranges(const AnyMachine& machine, const Pose& X_MT, double step) {
  const auto works = [&](double gamma) { return inverse(machine, twisted(X_MT, gamma)).reachable() != nullptr; };
  const std::vector<TwistRange> all{{-std::numbers::pi, std::numbers::pi}};
  if (task(machine).size() < 6) return works(0) ? all : std::vector<TwistRange>{};
  const int count = std::max(8, static_cast<int>(std::ceil(kTurn / step)));
  const auto angle = [&](int k) { return -std::numbers::pi + kTurn * k / count; };
  std::vector<bool> ok(static_cast<std::size_t>(count));
  for (int k = 0; k < count; ++k) ok[static_cast<std::size_t>(k)] = works(angle(k));
  if (std::all_of(ok.begin(), ok.end(), [](bool b) { return b; })) return all;
  const auto at = [&](int k) { return ok[static_cast<std::size_t>((k + count) % count)]; };
  /// The last angle that works between one that does and one that does not.
  const auto end_between = [&](double good, double bad) {
    while (std::abs(bad - good) > 1e-9) {
      const double middle = 0.5 * (good + bad);
      (works(middle) ? good : bad) = middle;
    }
    return good;
  };
  std::vector<TwistRange> ranges;
  for (int k = 0; k < count; ++k) {
    if (!at(k) || at(k - 1)) continue;  // only where a range begins
    int last = k;
    while (at(last + 1)) ++last;
    TwistRange range{end_between(angle(k), angle(k) - kTurn / count), end_between(angle(last), angle(last + 1))};
    if (range.from < -std::numbers::pi) {
      range.from += kTurn;
      range.to += kTurn;
    }
    ranges.push_back(range);
  }
  std::sort(ranges.begin(), ranges.end(), [](const TwistRange& a, const TwistRange& b) { return a.from < b.from; });
  return ranges;
}

std::optional<double> nearest_twist(const std::vector<TwistRange>& ranges, double margin) {
  std::optional<double> best;
  for (const TwistRange& range : ranges)
    for (const double turn : {-kTurn, 0.0, kTurn}) {
      double low = range.from + turn, high = range.to + turn;
      if (low <= 0 && high >= 0) return 0.0;
      const double inset = std::min(margin, 0.5 * (high - low));
      low += inset;
      high -= inset;
      const double gamma = low > 0 ? low : high;
      if (!best || std::abs(gamma) < std::abs(*best)) best = gamma;
    }
  return best;
}

}  // namespace polypod::kinematics
