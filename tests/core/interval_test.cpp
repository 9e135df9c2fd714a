// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Containment: for random intervals and random points in them the exact result lies in the interval's result. "Exact"
// is long double (64-bit mantissa): its own error is 2^-11 of the margin that an interval adds, so that containment is
// asked without a tolerance.
#include "polypod/core/interval.hpp"

#include <gtest/gtest.h>

#include <cfloat>
#include <limits>
#include <random>
#include <vector>

namespace polypod {
namespace {

static_assert(std::numeric_limits<long double>::digits >= 64, "the oracle needs more digits than double");

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr int kSamples = 100'000;
constexpr unsigned kSeed = 20260112;

class Sampler {
 public:
  double number() {
    const double magnitude = std::ldexp(unit_(engine_), exponent_(engine_));
    switch (kind_(engine_)) {
      case 0:
        return 0;
      case 1:
        return std::round(8 * unit_(engine_));  // small whole numbers: exact cases, equal ends
      default:
        return unit_(engine_) < 0.5 ? magnitude : -magnitude;
    }
  }
  Interval interval() {
    const double a = number();
    if (kind_(engine_) == 0) return a;
    const double b = kind_(engine_) < 4 ? a + std::abs(a) * 1e-15 * unit_(engine_) : number();
    return {std::min(a, b), std::max(a, b)};
  }
  /// An end or a point between them.
  double inside(const Interval& x) {
    const int k = kind_(engine_);
    if (k < 3) return x.lo();
    if (k < 6) return x.hi();
    return std::clamp(x.lo() + unit_(engine_) * (x.hi() - x.lo()), x.lo(), x.hi());
  }

 private:
  std::mt19937_64 engine_{kSeed};
  std::uniform_real_distribution<double> unit_{0, 1};
  std::uniform_int_distribution<int> exponent_{-40, 40};
  std::uniform_int_distribution<int> kind_{0, 9};
};

bool holds(const Interval& x, long double value) {
  return x.lo() <= value && value <= x.hi();
}

#define EXPECT_HOLDS(result, exact, x, y)                                                                          \
  ASSERT_TRUE(holds(result, exact)) << "seed " << kSeed << ", x = [" << (x).lo() << ", " << (x).hi() << "], y = [" \
                                    << (y).lo() << ", " << (y).hi() << "], result [" << (result).lo() << ", "      \
                                    << (result).hi() << "], exact " << (exact)

TEST(Interval, SumDifferenceProductAndQuotientHoldTheExactResult) {
  Sampler sampler;
  for (int k = 0; k < kSamples; ++k) {
    const Interval x = sampler.interval(), y = sampler.interval();
    const long double a = sampler.inside(x), b = sampler.inside(y);
    EXPECT_HOLDS(x + y, a + b, x, y);
    EXPECT_HOLDS(x - y, a - b, x, y);
    EXPECT_HOLDS(x * y, a * b, x, y);
    if (b != 0) {
      EXPECT_HOLDS(x / y, a / b, x, y);
    }
  }
}

TEST(Interval, SquareRootSquareSineCosineAndAbsHoldTheExactResult) {
  Sampler sampler;
  for (int k = 0; k < kSamples; ++k) {
    const Interval x = sampler.interval();
    const long double a = sampler.inside(x);
    EXPECT_HOLDS(square(x), a * a, x, x);
    EXPECT_HOLDS(abs(x), std::abs(a), x, x);
    if (a >= 0) {
      EXPECT_HOLDS(sqrt(x), std::sqrt(a), x, x);
    }
    if (std::abs(a) < 1e6L) {
      EXPECT_HOLDS(sin(x), std::sin(a), x, x);
      EXPECT_HOLDS(cos(x), std::cos(a), x, x);
    }
  }
}

TEST(Interval, SineAndCosineOfNarrowIntervalsRoundTheirExtremes) {
  Sampler sampler;
  for (int k = -40; k <= 40; ++k) {
    const double extreme = k * std::numbers::pi / 2;  // one of cos, sin is 1 or -1 within rounding
    for (double half : {0.0, 1e-17, 1e-15, 1e-9, 1e-3, 1.0, 3.0}) {
      const Interval x(extreme - half, extreme + half);
      const long double exact = k * std::numbers::pi_v<long double> / 2;
      if (holds(x, exact)) {
        EXPECT_HOLDS(cos(x), std::cos(exact), x, x);
        EXPECT_HOLDS(sin(x), std::sin(exact), x, x);
      }
      for (int i = 0; i < 100; ++i) {
        const long double a = sampler.inside(x);
        EXPECT_HOLDS(cos(x), std::cos(a), x, x);
        EXPECT_HOLDS(sin(x), std::sin(a), x, x);
      }
    }
  }
}

TEST(Interval, ResultsAreTight) {
  // An operation may widen each end by one unit in the last place and by what its rounding adds: 3 units at most.
  constexpr double kUnits = 3 * std::numeric_limits<double>::epsilon();
  Sampler sampler;
  for (int k = 0; k < kSamples; ++k) {
    const Interval x = sampler.number(), y = sampler.number();
    for (const Interval& r : {x + y, x - y, x * y, square(x), sqrt(abs(x))}) {
      ASSERT_LE(r.width(), kUnits * r.magnitude() + 4 * DBL_MIN);
    }
  }
  EXPECT_LT(cos(Interval(0.1, 0.2)).hi(), std::cos(0.1) + 1e-14);
  EXPECT_GT(cos(Interval(0.1, 0.2)).lo(), std::cos(0.2) - 1e-14);
  EXPECT_LT(sin(Interval(1.0, 1.5)).hi(), std::sin(1.5) + 1e-14);
}

TEST(Interval, SquareIsTighterThanTheProduct) {
  const Interval x(-1, 2);
  EXPECT_EQ(square(x).lo(), 0);
  const Interval any_other = x;
  EXPECT_LT((x * any_other).lo(), -1.9);
  // Of one object both factors are the same number.
  EXPECT_EQ(x * x, square(x));
  const Eigen::Matrix<Interval, 3, 1> v(x, x, x);
  EXPECT_GT(v.squaredNorm().lo(), -1e-300);  // but for the rounding of the sum
  EXPECT_GE(square(Interval(-1e-200, 1e-200)).lo(), 0);
  EXPECT_EQ(square(3.0), 9.0);
}

TEST(Interval, DivisionByZeroGivesTheWholeLine) {
  for (const Interval& y : {Interval(0), Interval(-1, 1), Interval(0, 1), Interval(-1, 0)}) {
    EXPECT_EQ(Interval(1) / y, Interval::whole());
  }
}

TEST(Interval, NotANumberGivesTheWholeLine) {
  const Interval bad(kNaN), good(1, 2), zero(0);
  for (const Interval& r :
       {bad + good, good - bad, bad * good, bad * zero, zero * bad, good / bad, bad / good, sqrt(bad), abs(bad)}) {
    EXPECT_EQ(r, Interval::whole());
  }
  EXPECT_TRUE(square(bad).contains(1e300));
  EXPECT_EQ(cos(bad), Interval(-1, 1));
}

TEST(Interval, OverflowKeepsTheExactResult) {
  const Interval huge(1e308), ten(10);
  const Interval product = huge * ten;  // 1e309, more than a double can hold
  EXPECT_LE(product.lo(), DBL_MAX);
  EXPECT_GT(product.lo(), 1e307);
  EXPECT_EQ(product.hi(), kInf);
  EXPECT_EQ((-huge * ten).lo(), -kInf);
  EXPECT_GE((-huge * ten).hi(), -DBL_MAX);
  EXPECT_EQ((Interval::whole() + huge).lo(), -kInf);
  EXPECT_TRUE((Interval::whole() * Interval(0, 1)).contains(5)) << "the whole line times [0, 1] holds everything";
}

TEST(Interval, UnderflowKeepsTheExactResult) {
  const Interval tiny(1e-200);
  EXPECT_LT((tiny * tiny).lo(), 1e-308L * 1e-92L);
  EXPECT_GT((tiny * tiny).hi(), 0);
}

TEST(Interval, ComparisonsAreCertain) {
  const Interval a(1, 2), b(2, 3), c(2.5, 4);
  EXPECT_TRUE(a < c);
  EXPECT_FALSE(a < b) << "2 may meet 2";
  EXPECT_TRUE(a <= b);
  EXPECT_FALSE(b < c);
  EXPECT_FALSE(b > c) << "neither is certain";
  EXPECT_TRUE(c > a);
  EXPECT_TRUE(c >= a);
}

TEST(Interval, SquareRootOfWhatIsPartlyNegativeTakesTheRest) {
  EXPECT_EQ(sqrt(Interval(-4, 9)).lo(), 0);
  EXPECT_TRUE(sqrt(Interval(-4, 9)).contains(3));
  EXPECT_EQ(sqrt(Interval(-4, -1)), Interval::whole());
}

TEST(Interval, WorksInEigen) {
  Eigen::Matrix<Interval, 2, 2> R;
  const Interval angle(0.3, 0.3 + 1e-9);
  R << cos(angle), -sin(angle), sin(angle), cos(angle);
  const Eigen::Matrix<Interval, 2, 2> unit = R.transpose() * R;
  EXPECT_TRUE(unit(0, 0).contains(1));
  EXPECT_TRUE(unit(0, 1).contains(0));
  constexpr double kWidth = 1e-8;  // a few times the width of the angle
  EXPECT_LT(unit(0, 0).width(), kWidth);
}

}  // namespace
}  // namespace polypod
