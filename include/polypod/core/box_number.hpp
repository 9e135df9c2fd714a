// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// First-order numbers that know their domain: the number type with which a closure or a limit says what it does over a
// whole box of poses and joints, with an error that falls with the square of the box.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "polypod/core/interval.hpp"
#include "polypod/core/number_traits.hpp"

namespace polypod {

/// The variables x that the numbers of one expression are about: |x_k| <= reach_k, but for two that may lie in a disc.
struct BoxDomain {
  static constexpr std::size_t kMost = 24;
  std::size_t count = 0;
  std::array<double, kMost> reach{};
  std::size_t disc = 0;  ///< where `radius` > 0, x_disc and x_disc+1 lie in a disc of that radius; their reach is 0
  double radius = 0;

  /// The most that gradient . x is.
  [[nodiscard]] double spread(const double* gradient) const {
    double sum = 0;
    for (std::size_t k = 0; k < count; ++k) sum += std::abs(gradient[k]) * reach[k];
    if (radius > 0) sum += radius * std::hypot(gradient[disc], gradient[disc + 1]);
    return sum;
  }
};

/// value + gradient . x + [-rest, rest] for all x of a domain; without a domain a plain number. Has the operations of
/// Interval, so that what is written for intervals works with it. An infinite rest: nothing is known.
///
/// The rounding of each operation is in the rest, that of gradients by (1 + 1e-15) of what they are multiplied with;
/// sums of gradients round to nearest, which the judge of a limit allows for.
class BoxNumber {
 public:
  BoxNumber() : BoxNumber(0.0) {}
  BoxNumber(double constant) : value_(constant) {}  // NOLINT(google-explicit-constructor): a number type
  BoxNumber(const BoxNumber& other) : value_(other.value_), rest_(other.rest_), domain_(other.domain_) {
    if (domain_ != nullptr) std::copy_n(other.gradient_.begin(), domain_->count, gradient_.begin());
  }
  BoxNumber& operator=(const BoxNumber& other) {
    value_ = other.value_;
    rest_ = other.rest_;
    domain_ = other.domain_;
    if (domain_ != nullptr && this != &other) std::copy_n(other.gradient_.begin(), domain_->count, gradient_.begin());
    return *this;
  }
  ~BoxNumber() = default;
  /// The value, a gradient of 0 that can be set, and the rest.
  BoxNumber(double value, const BoxDomain* domain, double rest = 0) : value_(value), rest_(rest), domain_(domain) {
    std::fill_n(gradient_.begin(), domain_->count, 0.0);
  }

  /// Any number of the range, without a domain.
  static BoxNumber of(const Interval& range) {
    BoxNumber out(std::isfinite(range.width()) ? range.mid() : 0.0);
    out.rest_ = std::isfinite(range.width()) ? 0.5 * range.width() + kRound * range.magnitude()
                                             : std::numeric_limits<double>::infinity();
    return out;
  }

  [[nodiscard]] double value() const { return value_; }
  [[nodiscard]] double rest() const { return rest_; }
  [[nodiscard]] double gradient(std::size_t k) const { return domain_ == nullptr ? 0.0 : gradient_[k]; }
  void set_gradient(std::size_t k, double g) { gradient_[k] = g; }
  /// How far it is from `value` at most.
  [[nodiscard]] double radius() const { return domain_ == nullptr ? rest_ : domain_->spread(gradient_.data()) + rest_; }
  [[nodiscard]] double lo() const { return value_ - radius(); }
  [[nodiscard]] double hi() const { return value_ + radius(); }

  friend BoxNumber operator+(const BoxNumber& a) { return a; }
  friend BoxNumber operator-(const BoxNumber& a) { return a.scaled(-1); }
  friend BoxNumber operator+(const BoxNumber& a, const BoxNumber& b) { return sum(a, b, 1); }
  friend BoxNumber operator-(const BoxNumber& a, const BoxNumber& b) { return sum(a, b, -1); }
  friend BoxNumber operator*(const BoxNumber& a, const BoxNumber& b) {
    if (&a == &b) return square(a);
    if (a.domain_ == nullptr && a.rest_ == 0) return b.scaled(a.value_);
    if (b.domain_ == nullptr && b.rest_ == 0) return a.scaled(b.value_);
    if (a.domain_ == nullptr) return b * a;
    BoxNumber out(Raw{}, a.value_ * b.value_, a.domain_);
    const double ra = a.radius(), rb = b.radius();
    for (std::size_t k = 0; k < a.domain_->count; ++k) {
      out.gradient_[k] = a.value_ * b.gradient(k) + b.value_ * a.gradient_[k];
    }
    out.rest_ = std::abs(a.value_) * b.rest_ + std::abs(b.value_) * a.rest_ + ra * rb +
                kRound * (std::abs(a.value_) + ra) * (std::abs(b.value_) + rb);
    return out.known();
  }
  friend BoxNumber operator/(const BoxNumber& a, const BoxNumber& b) {
    if (b.domain_ == nullptr && b.rest_ == 0 && b.value_ != 0) return a.scaled(1 / b.value_);
    const double low = b.lo(), high = b.hi();
    if (low > 0)
      return a * b.composed(1 / b.value_, -1 / square(b.value_), {0, 2 / (low * low * low)}, {1 / high, 1 / low});
    if (high < 0) return -(a / -b);
    return a.unknown();
  }
  BoxNumber& operator+=(const BoxNumber& b) { return *this = *this + b; }
  BoxNumber& operator-=(const BoxNumber& b) { return *this = *this - b; }
  BoxNumber& operator*=(const BoxNumber& b) { return *this = *this * b; }
  BoxNumber& operator/=(const BoxNumber& b) { return *this = *this / b; }

  /// Certain comparisons, as of intervals.
  friend bool operator<(const BoxNumber& a, const BoxNumber& b) { return (b - a).lo() > 0; }
  friend bool operator>(const BoxNumber& a, const BoxNumber& b) { return b < a; }
  friend bool operator<=(const BoxNumber& a, const BoxNumber& b) { return (b - a).lo() >= 0; }
  friend bool operator>=(const BoxNumber& a, const BoxNumber& b) { return b <= a; }
  friend bool operator==(const BoxNumber& a, const BoxNumber& b) {
    return a.radius() == 0 && b.radius() == 0 && a.value_ == b.value_;
  }
  friend bool operator!=(const BoxNumber& a, const BoxNumber& b) { return !(a == b); }

  friend BoxNumber square(const BoxNumber& a) {
    if (a.domain_ == nullptr && a.rest_ == 0) return {a.value_ * a.value_};
    const double spread = a.radius() - a.rest_, half = 0.5 * spread * spread;
    BoxNumber out = a.scaled(2 * a.value_);
    // Of the linear part alone the square lies in [0, spread^2].
    out.value_ = a.value_ * a.value_ + half;
    out.rest_ = half + (2 * std::abs(a.value_) + 2 * spread + a.rest_) * a.rest_ +
                kRound * polypod::square(std::abs(a.value_) + spread);
    return out.known();
  }
  /// The root of the part that is not negative.
  friend BoxNumber sqrt(const BoxNumber& a) {
    const double low = std::max(0.0, a.lo()), high = std::max(0.0, a.hi()), at = std::max(0.0, a.value_);
    const Interval range(std::sqrt(low), std::sqrt(high));
    if (!(low > 0)) return a.within(range);
    return a.composed(std::sqrt(at), 0.5 / std::sqrt(at), {-0.25 / (low * std::sqrt(low)), 0}, range);
  }
  friend BoxNumber abs(const BoxNumber& a) {
    const double low = a.lo(), high = a.hi();
    if (low >= 0) return a;
    if (high <= 0) return -a;
    return a.within({0, std::max(-low, high)});
  }
  friend BoxNumber sin(const BoxNumber& a) {
    const Interval range = sin(Interval(a.lo(), a.hi()));
    return a.composed(std::sin(a.value_), std::cos(a.value_), -range, range);
  }
  friend BoxNumber cos(const BoxNumber& a) {
    const Interval range = cos(Interval(a.lo(), a.hi()));
    return a.composed(std::cos(a.value_), -std::sin(a.value_), -range, range);
  }

 private:
  static constexpr double kRound = 4 * std::numeric_limits<double>::epsilon();
  struct Raw {};
  BoxNumber(Raw, double value, const BoxDomain* domain) : value_(value), domain_(domain) {}

  [[nodiscard]] BoxNumber scaled(double s) const {
    BoxNumber out(Raw{}, s * value_, domain_);
    if (domain_ != nullptr) {
      for (std::size_t k = 0; k < domain_->count; ++k) out.gradient_[k] = s * gradient_[k];
    }
    out.rest_ = s == 0 ? 0 : std::abs(s) * rest_ + (domain_ == nullptr ? 0.0 : kRound * std::abs(out.value_));
    return out;
  }
  static BoxNumber sum(const BoxNumber& a, const BoxNumber& b, double s) {
    if (a.domain_ == nullptr && b.domain_ != nullptr) return sum(b.scaled(s), a, 1);
    BoxNumber out(Raw{}, a.value_ + s * b.value_, a.domain_);
    out.rest_ = a.rest_ + b.rest_;
    if (a.domain_ == nullptr) return out;
    out.rest_ += kRound * (std::abs(a.value_) + std::abs(b.value_));
    if (b.domain_ == nullptr) {
      std::copy_n(a.gradient_.begin(), a.domain_->count, out.gradient_.begin());
    } else {
      for (std::size_t k = 0; k < a.domain_->count; ++k) out.gradient_[k] = a.gradient_[k] + s * b.gradient_[k];
    }
    return out;
  }
  [[nodiscard]] BoxNumber unknown() const {
    BoxNumber out(Raw{}, 0, domain_);
    if (domain_ != nullptr) std::fill_n(out.gradient_.begin(), domain_->count, 0.0);
    out.rest_ = std::numeric_limits<double>::infinity();
    return out;
  }
  [[nodiscard]] BoxNumber known() const { return std::isfinite(rest_) && std::isfinite(value_) ? *this : unknown(); }
  [[nodiscard]] BoxNumber within(const Interval& range) const {
    BoxNumber out = unknown();
    if (!std::isfinite(range.width())) return out;
    out.value_ = range.mid();
    out.rest_ = 0.5 * range.width() + kRound * range.magnitude();
    return out;
  }
  /// phi of this from phi and phi' at the value, phi'' over the range, and phi over the range.
  [[nodiscard]] BoxNumber composed(double phi, double slope, const Interval& bend, const Interval& range) const {
    if (domain_ == nullptr && rest_ == 0) return {phi};
    const double r = radius();
    const double low = 0.5 * r * r * std::min(0.0, bend.lo()), high = 0.5 * r * r * std::max(0.0, bend.hi());
    const double rest = std::abs(slope) * rest_ + 0.5 * (high - low);
    // The first order says no more than the range where it is much wider.
    if (!std::isfinite(rest) || std::abs(slope) * (r - rest_) + rest > 2 * range.width()) return within(range);
    BoxNumber out = scaled(slope);
    out.value_ = phi + 0.5 * (low + high);
    out.rest_ = rest + kRound * (std::abs(phi) + std::abs(slope) * (std::abs(value_) + r));
    return out.known();
  }

  double value_ = 0, rest_ = 0;
  const BoxDomain* domain_ = nullptr;
  std::array<double, BoxDomain::kMost> gradient_;  // as many as the domain has
};

}  // namespace polypod
/// \cond EIGEN_TRAITS
template <>
struct Eigen::NumTraits<polypod::BoxNumber> : polypod::NumberTraits<polypod::BoxNumber, 8, 16, 48> {};
/// \endcond
