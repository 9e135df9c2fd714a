// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Time laws against closed forms, and what stretching does to every derivative.
#include "polypod/motion/time_law.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace polypod::motion {
namespace {

constexpr double kRounding = 1e-12;

/// s''' = bend s': s = v sinh(k t) / k + a (cosh(k t) - 1) / k^2, or sin and cos where bend < 0.
struct Bent {
  double v, a, bend;
  [[nodiscard]] std::array<double, 4> at(double t) const {
    const double k = std::sqrt(std::abs(bend));
    const double S = (bend > 0 ? std::sinh(k * t) : std::sin(k * t)) / k;
    const double c = bend > 0 ? std::cosh(k * t) : std::cos(k * t);
    const double rate = v * c + a * S;
    return {v * S + a * (c - 1) / bend, rate, a * c + v * bend * S, bend * rate};
  }
};

TimeLaw::Block bent(const Bent& law, double from, double duration) {
  TimeLaw::Block out{from, 10, false, {}, 0};
  out.pieces.push_back({duration, {0, law.v, law.a / 2}, law.bend});
  return out;
}

TEST(TimeLaw, PiecesThatBendAreTheirClosedForms) {
  // The last two have k t where the series takes over from sinh and sin.
  for (const Bent law : {Bent{0.7, 0.4, 2.5}, {0.7, 0.4, -2.5}, {0.7, 0.4, 1e-3}, {0.7, 0.4, -1e-3}}) {
    TimeLaw time;
    time.add(bent(law, 0.3, 1.2));
    for (const double t : {0.0, 0.02, 0.5, 1.0, 1.2}) {
      const Series s = time.at(t);
      const std::array<double, 4> want = law.at(t);
      EXPECT_NEAR(s.value(), 0.3 + want[0], 1e-11) << law.bend << " " << t;
      for (int k = 1; k < 4; ++k)
        EXPECT_NEAR(s.derivative(k), want[static_cast<std::size_t>(k)], kRounding) << law.bend << " " << t << " " << k;
    }
  }
}

TEST(TimeLaw, StretchedByAFactorEachDerivativeFallsByItsPower) {
  const double factor = 1.7;
  for (const Bent law : {Bent{0.7, 0.4, 2.5}, {0.7, 0.4, -2.5}, {0.7, 0.4, 0}}) {
    TimeLaw time;
    time.add(uniform_block(0, 0.3, 0.5));
    time.add(bent(law, 0.3, 0.8));
    time.add(smooth_block(0.3 + 10, 1, 2));
    const TimeLaw before = time;
    time.stretch(1, factor);
    EXPECT_NEAR(time.duration(), 0.5 + 0.8 * factor + 2, kRounding);
    for (const double x : {0.1, 0.4, 0.7}) {
      const Series was = before.at(0.5 + x), now = time.at(0.5 + factor * x);
      for (int k = 0; k < 4; ++k)
        EXPECT_NEAR(now.derivative(k) * std::pow(factor, k), was.derivative(k), kRounding) << law.bend << " " << k;
    }
    // Blocks before and behind keep their pace.
    EXPECT_NEAR(time.at(0.25).value(), 0.15, kRounding);
    EXPECT_NEAR(time.at(time.duration() - 1).value(), 10.3 + 0.5, kRounding);
  }
}

TEST(TimeLaw, SmoothBlocksRestAtBothEnds) {
  TimeLaw time;
  time.add(smooth_block(2, 3, 1.5));
  for (const double t : {0.0, 1.5}) {
    EXPECT_NEAR(time.at(t).value(), t == 0 ? 2 : 5, kRounding);
    EXPECT_NEAR(time.at(t).derivative(1), 0, kRounding);
    EXPECT_NEAR(time.at(t).derivative(2), 0, 1e-11);
  }
  // The largest speed of 10 w^3 - 15 w^4 + 6 w^5 is 15/8 of the mean, half way.
  EXPECT_NEAR(time.at(0.75).derivative(1), 15.0 / 8 * 3 / 1.5, kRounding);
  EXPECT_NEAR(time.time_of(3.5), 0.75, 1e-9);
}

}  // namespace
}  // namespace polypod::motion
