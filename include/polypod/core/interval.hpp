// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Interval arithmetic: the number type with which a closure or a limit proves a statement about a whole box of poses.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "polypod/core/number_traits.hpp"

namespace polypod {

/// A closed interval [lo, hi] that holds every result of the operation on every choice of operands.
///
/// Rounding is to nearest, and each result is then moved outwards by its own rounding error (half a unit in the last
/// place, taken as |x| 2^-52 plus the smallest normal number): no rounding mode is switched, so the arithmetic is safe
/// in any thread and under any optimisation that keeps IEEE results. sqrt is correctly rounded; sin and cos are taken
/// to be within 2 units in the last place (glibc states less than 1).
///
/// x * x of one object is its square: both factors are the same number, which intervals of two objects do not know.
///
/// Empty intervals do not exist; a division by an interval that holds 0, or any NaN operand, gives the whole line.
class Interval {
 public:
  constexpr Interval() = default;
  constexpr Interval(double value) : lo_(value), hi_(value) {}  // NOLINT(google-explicit-constructor): a number type
  constexpr Interval(double lo, double hi) : lo_(lo), hi_(hi) {}

  static constexpr Interval whole() {
    return {-std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
  }

  [[nodiscard]] constexpr double lo() const { return lo_; }
  [[nodiscard]] constexpr double hi() const { return hi_; }
  [[nodiscard]] constexpr double mid() const { return 0.5 * (lo_ + hi_); }
  [[nodiscard]] constexpr double width() const { return hi_ - lo_; }
  [[nodiscard]] constexpr bool contains(double x) const { return lo_ <= x && x <= hi_; }
  [[nodiscard]] constexpr double magnitude() const { return std::max(-lo_, hi_) > 0 ? std::max(-lo_, hi_) : 0; }

  friend Interval operator-(const Interval& a) { return {-a.hi_, -a.lo_}; }
  friend Interval operator+(const Interval& a) { return a; }
  friend Interval operator+(const Interval& a, const Interval& b) { return outward(a.lo_ + b.lo_, a.hi_ + b.hi_); }
  friend Interval operator-(const Interval& a, const Interval& b) { return outward(a.lo_ - b.hi_, a.hi_ - b.lo_); }
  friend Interval square(const Interval& x) {
    const double a = x.lo_ * x.lo_, b = x.hi_ * x.hi_;
    const Interval outer = outward(x.contains(0) ? 0.0 : std::min(a, b), std::max(a, b));
    return {std::max(0.0, outer.lo_), outer.hi_};
  }
  friend Interval operator*(const Interval& a, const Interval& b) {
    if (&a == &b) return square(a);
    const double p = product(a.lo_, b.lo_), q = product(a.lo_, b.hi_);
    const double r = product(a.hi_, b.lo_), s = product(a.hi_, b.hi_);
    return outward(std::min(std::min(p, q), std::min(r, s)), std::max(std::max(p, q), std::max(r, s)));
  }
  friend Interval operator/(const Interval& a, const Interval& b) {
    if (!(b.lo_ > 0 || b.hi_ < 0)) return whole();
    const double p = a.lo_ / b.lo_, q = a.lo_ / b.hi_, r = a.hi_ / b.lo_, s = a.hi_ / b.hi_;
    return outward(std::min(std::min(p, q), std::min(r, s)), std::max(std::max(p, q), std::max(r, s)));
  }
  Interval& operator+=(const Interval& b) { return *this = *this + b; }
  Interval& operator-=(const Interval& b) { return *this = *this - b; }
  Interval& operator*=(const Interval& b) { return *this = *this * b; }
  Interval& operator/=(const Interval& b) { return *this = *this / b; }

  // Certain comparisons: true only if true for every choice of operands (so neither a < b nor a >= b may hold).
  friend bool operator<(const Interval& a, const Interval& b) { return a.hi_ < b.lo_; }
  friend bool operator>(const Interval& a, const Interval& b) { return a.lo_ > b.hi_; }
  friend bool operator<=(const Interval& a, const Interval& b) { return a.hi_ <= b.lo_; }
  friend bool operator>=(const Interval& a, const Interval& b) { return a.lo_ >= b.hi_; }
  friend bool operator==(const Interval& a, const Interval& b) { return a.lo_ == b.lo_ && a.hi_ == b.hi_; }
  friend bool operator!=(const Interval& a, const Interval& b) { return !(a == b); }

  /// [lo, hi] moved outwards by the rounding error of one operation.
  static Interval outward(double lo, double hi) {
    constexpr double kUlp = std::numeric_limits<double>::epsilon();
    constexpr double kTiny = std::numeric_limits<double>::min();
    constexpr double kMax = std::numeric_limits<double>::max();
    if (std::isnan(lo) || std::isnan(hi)) return whole();
    // An end that overflowed towards the other one stands for a number beyond the largest: it moves back to that.
    lo = std::min(lo, kMax);
    hi = std::max(hi, -kMax);
    return {lo - (std::abs(lo) * kUlp + kTiny), hi + (std::abs(hi) * kUlp + kTiny)};
  }

 private:
  static double product(double a, double b) {
    const double p = a * b;
    return std::isnan(p) && (a == 0 || b == 0) && !std::isnan(a) && !std::isnan(b) ? 0.0 : p;  // 0 * inf is 0 here
  }

  double lo_ = 0;
  double hi_ = 0;
};

/// x^2 of any number.
inline double square(double x) {
  return x * x;
}
template <class T>
T square(const T& x) {
  return x * x;
}

/// The square root of the part of x that is not negative.
inline Interval sqrt(const Interval& x) {
  if (!(x.hi() >= 0)) return Interval::whole();
  const Interval outer = Interval::outward(std::sqrt(std::max(0.0, x.lo())), std::sqrt(x.hi()));
  return {std::max(0.0, outer.lo()), outer.hi()};
}

inline Interval abs(const Interval& x) {
  if (std::isnan(x.lo()) || std::isnan(x.hi())) return Interval::whole();
  if (x.lo() >= 0) return x;
  if (x.hi() <= 0) return -x;
  return {0, std::max(-x.lo(), x.hi())};
}

namespace interval_detail {
// Whether some offset + 2 pi k (k whole) may lie in x; "may" is generous by far more than the rounding of pi.
inline bool may_hold_multiple(const Interval& x, double offset) {
  constexpr double kTwoPi = 2 * std::numbers::pi;
  constexpr double kGenerous = 1e-12;
  const double slack = kGenerous * (1 + x.magnitude());
  return std::floor((x.hi() + slack - offset) / kTwoPi) >= std::ceil((x.lo() - slack - offset) / kTwoPi);
}
}  // namespace interval_detail

inline Interval cos(const Interval& x) {
  if (!(x.width() < 2 * std::numbers::pi)) return {-1, 1};
  const double a = std::cos(x.lo()), b = std::cos(x.hi());
  constexpr double kLibm = 4 * std::numeric_limits<double>::epsilon();
  double lo = std::min(a, b) - kLibm, hi = std::max(a, b) + kLibm;
  if (interval_detail::may_hold_multiple(x, 0)) hi = 1;
  if (interval_detail::may_hold_multiple(x, std::numbers::pi)) lo = -1;
  return {std::max(-1.0, lo), std::min(1.0, hi)};
}

inline Interval sin(const Interval& x) {
  if (!(x.width() < 2 * std::numbers::pi)) return {-1, 1};
  const double a = std::sin(x.lo()), b = std::sin(x.hi());
  constexpr double kLibm = 4 * std::numeric_limits<double>::epsilon();
  double lo = std::min(a, b) - kLibm, hi = std::max(a, b) + kLibm;
  if (interval_detail::may_hold_multiple(x, std::numbers::pi / 2)) hi = 1;
  if (interval_detail::may_hold_multiple(x, -std::numbers::pi / 2)) lo = -1;
  return {std::max(-1.0, lo), std::min(1.0, hi)};
}

}  // namespace polypod
/// \cond EIGEN_TRAITS
template <>
struct Eigen::NumTraits<polypod::Interval> : polypod::NumberTraits<polypod::Interval, 2, 4, 12> {
  static polypod::Interval epsilon() { return {std::numeric_limits<double>::epsilon()}; }
  static polypod::Interval dummy_precision() { return {1e-12}; }
  static polypod::Interval highest() { return {std::numeric_limits<double>::max()}; }
  static polypod::Interval lowest() { return {std::numeric_limits<double>::lowest()}; }
  static int digits10() { return std::numeric_limits<double>::digits10; }
};
/// \endcond
