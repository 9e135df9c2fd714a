// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Power series that end after the third order: the number type with which a curve says how it moves on.
#pragma once

#include <array>
#include <cmath>

#include "polypod/core/number_traits.hpp"

namespace polypod {

/// c_0 + c_1 s + c_2 s^2 + c_3 s^3, exact to the third order: what a function of s does near s = 0. Its derivatives
/// are c_1, 2 c_2 and 6 c_3. What is written for numbers works with it (closures, rotations, paths).
class Series {
 public:
  static constexpr int kOrder = 3;

  Series() = default;
  Series(double constant) : c_{constant, 0, 0, 0} {}  // NOLINT(google-explicit-constructor): a number type
  Series(double value, double first, double second, double third) : c_{value, first, second / 2, third / 6} {}

  [[nodiscard]] double value() const { return c_[0]; }
  /// The derivative of this order at s = 0.
  [[nodiscard]] double derivative(int order) const {
    constexpr std::array<double, kOrder + 1> kFactorial{1, 1, 2, 6};
    return c_[static_cast<std::size_t>(order)] * kFactorial[static_cast<std::size_t>(order)];
  }
  double& operator[](int k) { return c_[static_cast<std::size_t>(k)]; }
  double operator[](int k) const { return c_[static_cast<std::size_t>(k)]; }

  friend Series operator+(const Series& a) { return a; }
  friend Series operator-(const Series& a) {
    Series out;
    for (int k = 0; k <= kOrder; ++k) out[k] = -a[k];
    return out;
  }
  friend Series operator+(const Series& a, const Series& b) {
    Series out;
    for (int k = 0; k <= kOrder; ++k) out[k] = a[k] + b[k];
    return out;
  }
  friend Series operator-(const Series& a, const Series& b) {
    Series out;
    for (int k = 0; k <= kOrder; ++k) out[k] = a[k] - b[k];
    return out;
  }
  friend Series operator*(const Series& a, const Series& b) {
    Series out;
    out[0] = a[0] * b[0];
    out[1] = a[0] * b[1] + a[1] * b[0];
    out[2] = a[0] * b[2] + a[1] * b[1] + a[2] * b[0];
    out[3] = a[0] * b[3] + a[1] * b[2] + a[2] * b[1] + a[3] * b[0];
    return out;
  }
  friend Series operator*(const Series& a, double b) {
    Series out;
    for (int k = 0; k <= kOrder; ++k) out[k] = a[k] * b;
    return out;
  }
  friend Series operator*(double a, const Series& b) { return b * a; }
  friend Series operator/(const Series& a, const Series& b) {
    Series out;
    for (int k = 0; k <= kOrder; ++k) {
      double rest = a[k];
      for (int j = 1; j <= k; ++j) rest -= b[j] * out[k - j];
      out[k] = rest / b[0];
    }
    return out;
  }
  Series& operator+=(const Series& b) { return *this = *this + b; }
  Series& operator-=(const Series& b) { return *this = *this - b; }
  Series& operator*=(const Series& b) { return *this = *this * b; }
  Series& operator/=(const Series& b) { return *this = *this / b; }

  /// By their values.
  friend bool operator<(const Series& a, const Series& b) { return a[0] < b[0]; }
  friend bool operator>(const Series& a, const Series& b) { return a[0] > b[0]; }
  friend bool operator<=(const Series& a, const Series& b) { return a[0] <= b[0]; }
  friend bool operator>=(const Series& a, const Series& b) { return a[0] >= b[0]; }
  friend bool operator==(const Series& a, const Series& b) { return a.c_ == b.c_; }
  friend bool operator!=(const Series& a, const Series& b) { return !(a == b); }

  friend Series abs(const Series& a) { return a[0] < 0 ? -a : a; }
  friend Series sqrt(const Series& a) {
    Series out;
    out[0] = std::sqrt(a[0]);
    out[1] = a[1] / (2 * out[0]);
    out[2] = (a[2] - out[1] * out[1]) / (2 * out[0]);
    out[3] = (a[3] - 2 * out[1] * out[2]) / (2 * out[0]);
    return out;
  }
  friend Series sin(const Series& a) { return composed(a, std::sin(a[0]), std::cos(a[0])); }
  friend Series cos(const Series& a) { return composed(a, std::cos(a[0]), -std::sin(a[0])); }

 private:
  /// f(a) of a function with f'' = -f.
  static Series composed(const Series& a, double f, double slope) {
    Series out;
    out[0] = f;
    out[1] = slope * a[1];
    out[2] = slope * a[2] - f * a[1] * a[1] / 2;
    out[3] = slope * a[3] - f * a[1] * a[2] - slope * a[1] * a[1] * a[1] / 6;
    return out;
  }

  std::array<double, kOrder + 1> c_{};
};

}  // namespace polypod

/// \cond EIGEN_TRAITS
template <>
struct Eigen::NumTraits<polypod::Series> : polypod::NumberTraits<polypod::Series, 4, 4, 10> {};
/// \endcond
