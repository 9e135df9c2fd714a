// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Cosines, sines and arctangents at once against the standard library's in 80 bits.
#include "polypod/geometry/trigonometry.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>
#include <random>

namespace polypod {
namespace {

using Four = std::array<double, 4>;
constexpr double kPi = std::numbers::pi, kLastPlace = std::numeric_limits<double>::epsilon();

/// Each at every place of the four.
void check_turn(double angle, double within) {
  for (std::size_t i = 0; i < 4; ++i) {
    Four angles{0.3, -1.1, 2.2, 40}, c, s;
    angles[i] = angle;
    cosines_and_sines(angles.data(), 4, c.data(), s.data());
    for (std::size_t k = 0; k < 4; ++k) {
      EXPECT_NEAR(c[k], static_cast<double>(std::cos(static_cast<long double>(angles[k]))), within) << angles[k];
      EXPECT_NEAR(s[k], static_cast<double>(std::sin(static_cast<long double>(angles[k]))), within) << angles[k];
    }
  }
}
/// Within 5e-16 rad.
void check_direction(double y, double x) {
  for (std::size_t i = 0; i < 4; ++i) {
    double ys[4]{0.3, -1.1, 2.2, 40}, xs[4]{-2, 1.1, 0.1, 40}, angle[4];
    ys[i] = y;
    xs[i] = x;
    angles_of(ys, xs, angle);
    // Where there are many, four are taken at a time: the same to the last bit.
    double many_y[12], many_x[12], many[12];
    for (std::size_t k = 0; k < 12; ++k) {
      many_y[k] = ys[(k + i) % 4];
      many_x[k] = xs[(k + i) % 4];
    }
    angles_of(many_y, many_x, many);
    for (std::size_t k = 0; k < 12; ++k) EXPECT_EQ(std::memcmp(&many[k], &angle[(k + i) % 4], sizeof(double)), 0) << k;
    for (std::size_t k = 0; k < 4; ++k) {
      const long double exact = std::atan2(static_cast<long double>(ys[k]), static_cast<long double>(xs[k]));
      EXPECT_NEAR(angle[k], static_cast<double>(exact), 5.5e-16) << ys[k] << " " << xs[k];
      EXPECT_EQ(std::signbit(angle[k]), std::signbit(exact)) << ys[k] << " " << xs[k];
    }
  }
}

TEST(Trigonometry, CosinesAndSinesToTheLastPlace) {
  std::mt19937 random(1);
  for (const double most : {1e-9, 0.1, 1.0, kPi, 30.0, 99999.0}) {
    std::uniform_real_distribution<double> angle(-most, most);
    for (int k = 0; k < 5000; ++k) check_turn(angle(random), 0.5 * kLastPlace);
  }
  for (int quarters = -9; quarters <= 9; ++quarters) check_turn(quarters * kPi / 2, 0.5 * kLastPlace);
  check_turn(-0.0, 0);
  for (const double far : {1e5, -123456.7, 1e22}) check_turn(far, kLastPlace);
}

TEST(Trigonometry, NoAngleHasNoCosine) {
  for (const double angle : {std::numeric_limits<double>::infinity(), std::numeric_limits<double>::quiet_NaN()}) {
    const Four angles{0.3, angle, 2.2, 40};
    Four c, s;
    cosines_and_sines(angles.data(), 4, c.data(), s.data());
    EXPECT_TRUE(std::isnan(c[1]) && std::isnan(s[1]));
    EXPECT_DOUBLE_EQ(c[0], std::cos(0.3));
  }
}

TEST(Trigonometry, AnglesOfDirections) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> one(-1, 1);
  for (const double scale : {1.0, 1e-12, 1e9, 1e-300})
    for (int k = 0; k < 5000; ++k) check_direction(scale * one(random), one(random));
  for (const double y : {0.0, -0.0, 1.0, -1.0})
    for (const double x : {0.0, 1.0, -1.0, 0.41421356, -0.41421357, 2.41421356}) check_direction(y, x);
}

}  // namespace
}  // namespace polypod
