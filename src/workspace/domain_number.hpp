// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// First-order numbers that know their domain, as a number type for closures and limits; and tangents on intervals.
#pragma once

#include <Eigen/Core>

#include "first_order.hpp"
#include "polypod/core/interval.hpp"
#include "polypod/core/number_traits.hpp"

namespace polypod::workspace {

/// A first-order number with the cell and patch it is about, so that it can be multiplied like any number. Numbers of
/// one expression share a domain; constants have none.
class DomainNumber {
 public:
  DomainNumber() = default;
  DomainNumber(double constant) : f_(constant) {}  // NOLINT(google-explicit-constructor): a number type
  DomainNumber(const FirstOrder& f, const Domain* domain) : f_(f), domain_(domain) {}

  [[nodiscard]] const FirstOrder& first_order() const { return f_; }
  [[nodiscard]] const Domain* domain() const { return domain_; }
  [[nodiscard]] double radius() const { return domain_ == nullptr ? f_.rest : f_.radius(*domain_); }

  friend DomainNumber operator+(const DomainNumber& a, const DomainNumber& b) { return {a.f_ + b.f_, of(a, b)}; }
  friend DomainNumber operator-(const DomainNumber& a, const DomainNumber& b) { return {a.f_ - b.f_, of(a, b)}; }
  friend DomainNumber operator-(const DomainNumber& a) { return {-1.0 * a.f_, a.domain_}; }
  friend DomainNumber operator*(const DomainNumber& a, const DomainNumber& b) {
    if (a.domain_ == nullptr) return {a.f_.value * b.f_, b.domain_};
    if (b.domain_ == nullptr) return {b.f_.value * a.f_, a.domain_};
    return {times(a.f_, b.f_, *a.domain_), a.domain_};
  }
  DomainNumber& operator+=(const DomainNumber& b) { return *this = *this + b; }
  DomainNumber& operator-=(const DomainNumber& b) { return *this = *this - b; }
  DomainNumber& operator*=(const DomainNumber& b) { return *this = *this * b; }

  /// f^2, f's root where it is not negative, sine and cosine.
  friend DomainNumber square(const DomainNumber& a) {
    return a.domain_ == nullptr ? DomainNumber(a.f_.value * a.f_.value)
                                : DomainNumber(workspace::square(a.f_, *a.domain_), a.domain_);
  }
  friend DomainNumber sqrt(const DomainNumber& a) {
    return a.domain_ == nullptr ? DomainNumber(std::sqrt(std::max(0.0, a.f_.value)))
                                : DomainNumber(root(a.f_, *a.domain_), a.domain_);
  }
  friend DomainNumber sin(const DomainNumber& a) { return a.turned(std::sin(a.f_.value), std::cos(a.f_.value)); }
  friend DomainNumber cos(const DomainNumber& a) { return a.turned(std::cos(a.f_.value), -std::sin(a.f_.value)); }

 private:
  static const Domain* of(const DomainNumber& a, const DomainNumber& b) {
    return a.domain_ != nullptr ? a.domain_ : b.domain_;
  }
  /// A sine or cosine from its value and slope; its second derivative is at most 1.
  [[nodiscard]] DomainNumber turned(double value, double slope) const {
    if (domain_ == nullptr) return {value};
    if (!std::isfinite(f_.radius(*domain_))) return {first_order_detail::unknown(), domain_};
    return {first_order_detail::compose(f_, *domain_, value, slope, 1.0, -1.0, 1.0), domain_};
  }

  FirstOrder f_;
  const Domain* domain_ = nullptr;
};

/// A number with its derivatives by up to 5 variables.
template <class T>
struct Tangent {
  static constexpr std::size_t kMost = 5;
  T value{0.0};
  std::array<T, kMost> by{};

  Tangent() { by.fill(T(0.0)); }
  Tangent(double constant) : Tangent() { value = T(constant); }  // NOLINT(google-explicit-constructor): a number type
  explicit Tangent(const T& v) requires(!std::is_same_v<T, double>) : Tangent() { value = v; }

  template <class F>
  static Tangent made(const T& value, F&& derivative) {
    Tangent out(value);
    for (std::size_t k = 0; k < kMost; ++k) out.by[k] = derivative(k);
    return out;
  }
  friend Tangent operator+(const Tangent& a, const Tangent& b) {
    return made(a.value + b.value, [&](std::size_t k) { return a.by[k] + b.by[k]; });
  }
  friend Tangent operator-(const Tangent& a, const Tangent& b) {
    return made(a.value - b.value, [&](std::size_t k) { return a.by[k] - b.by[k]; });
  }
  friend Tangent operator-(const Tangent& a) {
    return made(-a.value, [&](std::size_t k) { return -a.by[k]; });
  }
  friend Tangent operator*(const Tangent& a, const Tangent& b) {
    return made(a.value * b.value, [&](std::size_t k) { return a.value * b.by[k] + a.by[k] * b.value; });
  }
  Tangent& operator+=(const Tangent& b) { return *this = *this + b; }
  Tangent& operator-=(const Tangent& b) { return *this = *this - b; }
  Tangent& operator*=(const Tangent& b) { return *this = *this * b; }
  friend Tangent square(const Tangent& a) {
    using polypod::square;
    return made(square(a.value), [&](std::size_t k) { return T(2.0) * a.value * a.by[k]; });
  }
  friend Tangent sqrt(const Tangent& a) {
    using std::sqrt;
    const T root = sqrt(a.value), slope = T(0.5) / root;
    return made(root, [&](std::size_t k) { return slope * a.by[k]; });
  }
  friend Tangent sin(const Tangent& a) {
    using std::cos, std::sin;
    const T slope = cos(a.value);
    return made(sin(a.value), [&](std::size_t k) { return slope * a.by[k]; });
  }
  friend Tangent cos(const Tangent& a) {
    using std::cos, std::sin;
    const T slope = -sin(a.value);
    return made(cos(a.value), [&](std::size_t k) { return slope * a.by[k]; });
  }
};

}  // namespace polypod::workspace

template <>
struct Eigen::NumTraits<polypod::workspace::DomainNumber>
    : polypod::NumberTraits<polypod::workspace::DomainNumber, 8, 8, 24> {};

namespace polypod::workspace {

/// The length of a vector over its domain.
inline DomainNumber norm(const Eigen::Matrix<DomainNumber, 3, 1>& y) {
  const std::array<FirstOrder, 3> f{y[0].first_order(), y[1].first_order(), y[2].first_order()};
  for (int k = 0; k < 3; ++k)
    if (y[k].domain() != nullptr) return {norm(f, *y[k].domain()), y[k].domain()};
  return {Vec3(f[0].value, f[1].value, f[2].value).norm()};
}

}  // namespace polypod::workspace
template <class T>
struct Eigen::NumTraits<polypod::workspace::Tangent<T>>
    : polypod::NumberTraits<polypod::workspace::Tangent<T>, 8, 8, 24> {};
