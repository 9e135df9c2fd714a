// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Figures at any scale.
#include "polypod/core/figures.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace polypod {
namespace {

TEST(Figures, KeepTheUsualDecimalsWhereTheyShowEnough) {
  EXPECT_EQ(figure(12.3456, 2), "12.35");
  EXPECT_EQ(figure(233574.4, 0), "233574");
  EXPECT_EQ(Figures(100, 2)(0.0123), "0.01");  // beside a large one
  EXPECT_EQ(figure(0, 2), "0.00");
  EXPECT_EQ(figure(161715359.72, 6), "161715360");  // no figure holds fifteen digits
  EXPECT_EQ(figure(1234.5678901, 6), "1234.56789");
  EXPECT_EQ(figure(1161715359.72, 6), "1.16e+09");
  EXPECT_EQ(Figures(55, 1)(-0.03), "0.0");
  EXPECT_EQ(Figures(55, 1)(-0.07), "-0.1");
}

TEST(Figures, ShowThreeDigitsOfSmallOnes) {
  EXPECT_EQ(figure(0.012345, 2), "0.0123");
  EXPECT_EQ(figure(-0.00098765, 2), "-0.000988");
  EXPECT_EQ(figure(1.2345e-7, 0), "0.000000123");
  EXPECT_EQ(figure(1.2345e-12, 0), "1.23e-12");
  EXPECT_EQ(Figures(1e-12, 0)(0), "0");
}

TEST(Figures, SayWhatIsNoFiniteNumberAndWhatIsRounding) {
  EXPECT_EQ(figure(6.12e17, 0, 5), "6.1200e+17");  // no machine's volume holds eighteen digits
  EXPECT_EQ(figure(-1e300, 4), "-1.00e+300");
  EXPECT_EQ(figure(463613305.4, 0), "463613305");
  EXPECT_EQ(figure(std::numeric_limits<double>::infinity(), 2), "infinite");
  EXPECT_EQ(figure(-std::numeric_limits<double>::infinity(), 2), "-infinite");
  EXPECT_EQ(figure(std::nan(""), 2), "none");
  EXPECT_EQ(Figures(1e-3, 2)(3e-18), "0.00000");
}

TEST(Figures, EveryScaleReadsBackToWithinItsDigits) {
  // Independent of the rule: what is printed is within half a unit of the third digit, at every scale.
  for (int exponent = -15; exponent < 8; ++exponent)
    for (const double mantissa : {1.0, 1.23456, 4.998, 9.9949}) {
      const double value = mantissa * std::pow(10, exponent);
      EXPECT_NEAR(std::stod(figure(value, 0)) / value, 1, exponent < 2 ? 0.00501 : 0.0051) << value;
    }
}

}  // namespace
}  // namespace polypod
