// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Splines: G5 and G5.1.
#include <algorithm>
#include <cmath>

#include "engine.hpp"
#include "words.hpp"

namespace polypod::gcode {

/// G5 and G5.1. The plain program gets lines, closer to the curve than 0.5 um.
Status Engine::spline(int motion) {
  const int column = g_word(motion) != nullptr ? g_word(motion)->column : 1;
  const auto bad = [&](std::string_view what) {
    return error(column, "GC127", fmt::format("G{}: {}", motion == 50 ? "5" : "5.1", what), "check the block");
  };
  if (plane_ != Plane::xy) return bad("a spline outside of G17");
  if (left_ && options_.plain) {
    return error(column, "GC176", "a spline is the first move after G40", "leave the contour with a line");
  }
  if (inverse_) return bad("a spline under G93");
  if (find('Z') != nullptr || find('A') != nullptr || find('B') != nullptr || find('C') != nullptr) {
    return bad("a spline with an axis other than X and Y");
  }
  const Axes end = target();
  const bool cubic = motion == 50;
  const bool centre = find('I') != nullptr || find('J') != nullptr;
  std::array<double, 2> tangent{value('I'), value('J')};
  if (cubic) {
    if (find('P') == nullptr || find('Q') == nullptr) return bad("P and Q are missing");
    if (!centre) {
      if (!after_spline_) return bad("I and J of the first spline are missing");
      tangent = spline_tangent_;
    } else if (find('I') == nullptr || find('J') == nullptr) {
      return bad("I without J, or J without I");
    }
    spline_tangent_ = {-value('P'), -value('Q')};
  } else if (!centre || (tangent[0] == 0 && tangent[1] == 0)) {
    return bad("I and J are missing or 0");
  }
  spline_now_ = cubic;
  put("NURBS_FEED({}, ...)", cubic ? 4 : 3);
  const Axes start = current_;
  const auto point = [&](double t) {
    Axes p = start;
    const std::array<double, 2> ends{value('P'), value('Q')};
    for (std::size_t k = 0; k < 2; ++k) {
      const double a = start[k] + tangent[k];
      const double u = 1 - t;
      p[k] = cubic ? u * u * u * start[k] + 3 * u * u * t * a + 3 * u * t * t * (end[k] + ends[k]) + t * t * t * end[k]
                   : u * u * start[k] + 2 * u * t * a + t * t * end[k];
    }
    return p;
  };
  if (options_.plain) {
    // A chord of a step h is off by at most h^2 / 8 of the second derivative.
    const auto second = [&](double t) {
      const double h = 1e-3;
      const Axes a = point(t - h);
      const Axes b = point(t);
      const Axes c = point(t + h);
      return std::hypot(a[0] - 2 * b[0] + c[0], a[1] - 2 * b[1] + c[1]) / (h * h);
    };
    const double bend = std::max(second(1e-3), second(1 - 1e-3));
    const double chord = inches_ ? 5e-4 / kMmPerInch : 5e-4;
    const int count = static_cast<int>(std::clamp(std::ceil(std::sqrt(bend / (8 * chord))), 1.0, 5000.0));
    lines_ += count;
    for (int i = 1; i <= count; ++i) {
      const Axes p = i == count ? end : point(static_cast<double>(i) / count);
      plain("G1" + plain_words(p, true));
      current_ = p;
    }
  }
  plain_motion_ = 1;
  move_to(end);
  return {};
}

}  // namespace polypod::gcode
