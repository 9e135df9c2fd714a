// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Functions over a cell and a patch as value, gradient and a bound on the rest: the arithmetic with which closed
// inverse kinematics proves statements about whole boxes.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "patches.hpp"

namespace polypod::workspace {

/// The cell and patch that first-order numbers are about.
struct Domain {
  Vec3 half;
  const Patch* patch = nullptr;

  /// The most that a linear function with this gradient changes from the middle.
  [[nodiscard]] double spread(const std::array<double, 5>& g) const {
    const double position = std::abs(g[0]) * half[0] + std::abs(g[1]) * half[1] + std::abs(g[2]) * half[2];
    const double direction =
        patch->sector ? std::hypot(g[3], g[4]) * patch->turn
                      : std::abs(g[3]) * std::abs(patch->corner[3][0]) + std::abs(g[4]) * std::abs(patch->corner[3][1]);
    return position + direction;
  }
};

/// f = value + gradient . (x, s, t) + [-rest, rest] everywhere in the domain. `rest` infinite: nothing is known.
class FirstOrder {
 public:
  FirstOrder() = default;
  FirstOrder(double constant) : value(constant) {}  // NOLINT(google-explicit-constructor): a number type
  double value = 0;
  std::array<double, 5> gradient{};
  double rest = 0;

  [[nodiscard]] double radius(const Domain& d) const { return d.spread(gradient) + rest; }

  friend FirstOrder operator+(FirstOrder a, const FirstOrder& b) {
    a.value += b.value;
    for (std::size_t k = 0; k < 5; ++k) a.gradient[k] += b.gradient[k];
    a.rest += b.rest;
    return a;
  }
  friend FirstOrder operator*(double s, FirstOrder a) {
    a.value *= s;
    for (double& g : a.gradient) g *= s;
    a.rest *= std::abs(s);
    return a;
  }
  friend FirstOrder operator-(FirstOrder a, const FirstOrder& b) {
    a.value -= b.value;
    for (std::size_t k = 0; k < 5; ++k) a.gradient[k] -= b.gradient[k];
    a.rest += b.rest;
    return a;
  }
  friend FirstOrder operator-(FirstOrder a, double b) {
    a.value -= b;
    return a;
  }
  friend FirstOrder operator+(FirstOrder a, double b) {
    a.value += b;
    return a;
  }
};

/// (a + da) (b + db) = a b + a db + b da + da db.
inline FirstOrder times(const FirstOrder& a, const FirstOrder& b, const Domain& d) {
  FirstOrder out;
  out.value = a.value * b.value;
  for (std::size_t k = 0; k < 5; ++k) out.gradient[k] = a.value * b.gradient[k] + b.value * a.gradient[k];
  out.rest = std::abs(a.value) * b.rest + std::abs(b.value) * a.rest + a.radius(d) * b.radius(d);
  return out;
}

/// a^2: what da^2 in [0, radius^2] adds is one-sided.
inline FirstOrder square(const FirstOrder& a, const Domain& d) {
  const double spread = d.spread(a.gradient);
  FirstOrder out;
  out.value = a.value * a.value + 0.5 * spread * spread;
  for (std::size_t k = 0; k < 5; ++k) out.gradient[k] = 2 * a.value * a.gradient[k];
  out.rest = 0.5 * spread * spread + (2 * std::abs(a.value) + 2 * spread + a.rest) * a.rest;
  return out;
}

namespace first_order_detail {
/// phi(f) from phi, phi' at the value and a bound on |phi''| over the range; or, if that is narrower or phi'' has no
/// bound, the range of phi alone.
inline FirstOrder compose(const FirstOrder& f, const Domain& d, double phi, double slope, double bend, double low,
                          double high) {
  const double r = f.radius(d);
  FirstOrder out;
  const double rest = std::abs(slope) * f.rest + 0.5 * bend * r * r;
  if (std::isfinite(rest) && std::abs(slope) * (r - f.rest) + rest <= 2 * (high - low)) {
    out.value = phi;
    for (std::size_t k = 0; k < 5; ++k) out.gradient[k] = slope * f.gradient[k];
    out.rest = rest;
  } else {
    out.value = 0.5 * (low + high);
    out.rest = 0.5 * (high - low);
  }
  return out;
}
inline FirstOrder unknown() {
  FirstOrder out;
  out.rest = std::numeric_limits<double>::infinity();
  return out;
}
}  // namespace first_order_detail

/// The root of the part of f that is not negative.
inline FirstOrder root(const FirstOrder& f, const Domain& d) {
  const double r = f.radius(d), low = f.value - r, high = f.value + r;
  if (!std::isfinite(r)) return first_order_detail::unknown();
  const double root_low = std::sqrt(std::max(0.0, low)), root_high = std::sqrt(std::max(0.0, high));
  const double at = std::sqrt(std::max(0.0, f.value));
  const double bend = low > 0 ? 0.25 / (low * root_low) : std::numeric_limits<double>::infinity();
  return first_order_detail::compose(f, d, at, at > 0 ? 0.5 / at : 0.0, bend, root_low, root_high);
}

/// The length of a vector that is not 0 in the middle. It is convex, and curves by no more than
///   |dy|^2 / (2 (|y| - |dy|)),
/// which the root of a sum of squares would count twice and on both sides.
inline FirstOrder norm(const std::array<FirstOrder, 3>& y, const Domain& d) {
  const double length = std::sqrt(y[0].value * y[0].value + y[1].value * y[1].value + y[2].value * y[2].value);
  double moved2 = 0;
  for (const FirstOrder& component : y) moved2 += component.radius(d) * component.radius(d);
  const double moved = std::sqrt(moved2);
  FirstOrder out(length);
  if (!(length > moved)) {  // |y| - |dy| <= |y + dy| <= |y| + |dy|
    out.rest = std::isfinite(moved) ? moved : std::numeric_limits<double>::infinity();
    return out;
  }
  const double curvature = std::min(moved2 / (2 * (length - moved)), 2 * moved);
  for (const FirstOrder& component : y) {
    const double share = component.value / length;
    for (std::size_t k = 0; k < 5; ++k) out.gradient[k] += share * component.gradient[k];
    out.rest += std::abs(share) * component.rest;
  }
  out.value += 0.5 * curvature;
  out.rest += 0.5 * curvature;
  return out;
}

/// What R(s, t) b of a patch is, for a vector b that turns with the tool.
inline std::array<FirstOrder, 3> turned(const Patch& patch, const Vec3& b) {
  const Vec3 v = patch.R * b, v1 = patch.omega1.cross(v), v2 = patch.omega2.cross(v);
  const double bend = patch.bend * b.norm();
  std::array<FirstOrder, 3> out;
  for (int k = 0; k < 3; ++k) {
    FirstOrder& component = out[static_cast<std::size_t>(k)];
    component.value = v[k];
    component.gradient = {0, 0, 0, v1[k], v2[k]};
    component.rest = bend;
  }
  return out;
}

/// 1 / f where f is positive throughout.
inline FirstOrder inverse_of_positive(const FirstOrder& f, const Domain& d) {
  const double r = f.radius(d), low = f.value - r;
  if (!(low > 0) || !std::isfinite(r)) return first_order_detail::unknown();
  return first_order_detail::compose(f, d, 1 / f.value, -1 / (f.value * f.value), 2 / (low * low * low),
                                     1 / (f.value + r), 1 / low);
}

}  // namespace polypod::workspace
