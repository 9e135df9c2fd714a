// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/design/sensitivity.hpp"

#include <cmath>
#include <numbers>

#include "polypod/design/optimize.hpp"
#include "studies.hpp"

namespace polypod::design {
namespace {

constexpr double kPi = std::numbers::pi;

/// y = sin x1 + 7 sin^2 x2 + 0.1 x3^4 sin x1, each x in -pi to pi (Ishigami and Homma 1990).
double ishigami(const std::vector<double>& u) {
  const auto x = [&](std::size_t i) { return kPi * (2 * u[i] - 1); };
  return std::sin(x(0)) + 7 * std::pow(std::sin(x(1)), 2) + 0.1 * std::pow(x(2), 4) * std::sin(x(0));
}

std::vector<double> values_of(const SampleDesign& design, const std::function<double(const std::vector<double>&)>& f) {
  std::vector<double> out;
  for (const auto& u : design.points) out.push_back(f(u));
  return out;
}

/// Saltelli et al. 2008, (4.34) to (4.37): V1 = (1 + b pi^4 / 5)^2 / 2, V2 = a^2 / 8, V13 = 8 b^2 pi^8 / 225.
TEST(Sensitivity, SobolSharesOfTheIshigamiFunction) {
  const double a = 7, b = 0.1;
  const double V1 = 0.5 * std::pow(1 + b * std::pow(kPi, 4) / 5, 2), V2 = a * a / 8;
  const double V13 = 8 * b * b * std::pow(kPi, 8) / 225, V = V1 + V2 + V13;
  const std::array<double, 3> first{V1 / V, V2 / V, 0}, total{(V1 + V13) / V, V2 / V, V13 / V};
  int inside = 0;
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    const auto design = sample_design(SensitivityMethod::sobol, 3, 20'000, seed);
    ASSERT_TRUE(design);
    EXPECT_EQ(design->groups, 4000);
    const GlobalSensitivity s = global_sensitivity(*design, values_of(*design, ishigami));
    EXPECT_EQ(s.used, 4000);
    for (std::size_t i = 0; i < 3; ++i) {
      constexpr double kSampling = 0.06;  // 3 standard deviations of the widest estimate with 4000 samples
      EXPECT_NEAR(s.first[i].value, first[i], kSampling) << i;
      EXPECT_NEAR(s.total[i].value, total[i], kSampling) << i;
      for (const auto& [e, exact] : {std::pair{s.first[i], first[i]}, std::pair{s.total[i], total[i]}}) {
        EXPECT_LT(e.lower, e.value);
        EXPECT_GT(e.upper, e.value);
        inside += e.lower <= exact && exact <= e.upper ? 1 : 0;
      }
    }
  }
  // 95 % intervals: of 18 fewer than 14 hold the exact share with a probability of 0.02 %.
  EXPECT_GE(inside, 14);
}

TEST(Sensitivity, ALinearModelHasItsCoefficients) {
  const std::vector<double> a{3, -1, 0.5, 0};
  const auto linear = [&](const std::vector<double>& u) {
    double y = 7;
    for (std::size_t i = 0; i < a.size(); ++i) y += a[i] * u[i];
    return y;
  };
  const auto morris = sample_design(SensitivityMethod::morris, 4, 50, 5);
  ASSERT_TRUE(morris);
  const GlobalSensitivity m = global_sensitivity(*morris, values_of(*morris, linear));
  for (std::size_t i = 0; i < a.size(); ++i) {
    constexpr double kRounding = 1e-12;
    EXPECT_NEAR(m.first[i].value, a[i], kRounding);
    EXPECT_NEAR(m.total[i].value, std::abs(a[i]), kRounding);
    EXPECT_NEAR(m.total[i].lower, std::abs(a[i]), kRounding);
    EXPECT_NEAR(m.total[i].upper, std::abs(a[i]), kRounding);
    EXPECT_NEAR(m.spread[i], 0, 1e-7);
  }
  const auto sobol = sample_design(SensitivityMethod::sobol, 4, 60'000, 5);
  ASSERT_TRUE(sobol);
  const GlobalSensitivity s = global_sensitivity(*sobol, values_of(*sobol, linear));
  const double squares = 9 + 1 + 0.25;
  for (std::size_t i = 0; i < a.size(); ++i) {
    constexpr double kSampling = 0.03;
    EXPECT_NEAR(s.first[i].value, a[i] * a[i] / squares, kSampling);
    EXPECT_NEAR(s.total[i].value, a[i] * a[i] / squares, kSampling);
  }
}

TEST(Sensitivity, MorrisTrajectoriesMoveOneParameterAtATimeOnFourLevels) {
  const auto d = sample_design(SensitivityMethod::morris, 6, 100, 3);
  ASSERT_TRUE(d);
  EXPECT_EQ(d->groups, 14);
  EXPECT_EQ(d->points.size(), 98U);
  for (std::size_t k = 0; k < d->points.size(); ++k) {
    for (const double u : d->points[k]) EXPECT_NEAR(3 * u, std::round(3 * u), 1e-12);
    if (k % 7 == 0) continue;
    int moved = 0;
    for (std::size_t i = 0; i < 6; ++i) moved += d->points[k][i] != d->points[k - 1][i] ? 1 : 0;
    EXPECT_EQ(moved, 1);
  }
  // More evaluations begin with the same ones.
  const auto more = sample_design(SensitivityMethod::morris, 6, 200, 3);
  ASSERT_TRUE(more);
  for (std::size_t k = 0; k < d->points.size(); ++k) EXPECT_EQ(d->points[k], more->points[k]);
}

TEST(Sensitivity, WhatHasNoValueIsLeftOutAndCounted) {
  const auto d = sample_design(SensitivityMethod::morris, 2, 60, 1);
  ASSERT_TRUE(d);
  auto values = values_of(*d, [](const auto& u) { return 2 * u[0] - u[1]; });
  values[4] = std::numeric_limits<double>::quiet_NaN();
  // The second trajectory lacks its middle point, and so both of its effects.
  const GlobalSensitivity s = global_sensitivity(*d, values);
  EXPECT_EQ(s.used, 19);
  EXPECT_NEAR(s.first[0].value, 2, 1e-12);
  // Without its last point it still has the first effect.
  values[4] = values[3];
  values[5] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(global_sensitivity(*d, values).used, 20);
  // Three effects of a parameter are too few to say anything.
  std::vector<double> few_left(values.size(), std::numeric_limits<double>::quiet_NaN());
  std::copy(values.begin(), values.begin() + 3, few_left.begin());
  std::copy(values.begin() + 6, values.begin() + 12, few_left.begin() + 6);
  EXPECT_TRUE(std::isnan(global_sensitivity(*d, few_left).total[0].value));
  const auto few = sample_design(SensitivityMethod::morris, 2, 11, 1);
  ASSERT_FALSE(few);
  EXPECT_EQ(few.error().id, "OP150");
  // A constant has no variance to share.
  const auto sobol = sample_design(SensitivityMethod::sobol, 2, 64, 1);
  ASSERT_TRUE(sobol);
  EXPECT_TRUE(
      std::isnan(global_sensitivity(*sobol, values_of(*sobol, [](const auto&) { return 4.0; })).total[0].value));
}

/// Height of the strut hexapod of studies.hpp: sqrt(70^2 - r1^2 - r2^2 + 2 r1 r2 cos 30 deg).
TEST(Sensitivity, OfAStudyIsKeptAndTakenAgain) {
  const Folder folder;
  const std::string text = R"(evaluations = 12
[[vary]]
key = "base.radius_mm"
min = 40
max = 60
[[vary]]
key = "platform.radius_mm"
min = 20
max = 30
[[goal]]
figure = "height_mm"
sense = "max"
[[hold]]
figure = "footprint_mm2"
max = 1
)";
  const Study s = study_on_strut(text);
  auto store = Store::open(folder / "a", s, "machine = \"strut\"\n" + text, "1.0");
  ASSERT_TRUE(store) << to_string(store.error());
  SensitivityOptions options;
  options.version = "1.0";
  const auto whole = study_sensitivity(s, *store, SensitivityMethod::morris, 60, 1, options);
  ASSERT_TRUE(whole) << to_string(whole.error());
  EXPECT_TRUE(whole->complete);
  EXPECT_GT(whole->computed, 10);  // there are 16 corners of the levels
  EXPECT_LE(whole->computed, 16);
  ASSERT_EQ(whole->of.size(), 3U);
  EXPECT_EQ(whole->of[1].of, "height_mm");
  EXPECT_EQ(whole->of[1].used, 20);
  const double c = std::cos(kPi / 6);
  const auto height = [&](double r1, double r2) { return std::sqrt(4900 - r1 * r1 - r2 * r2 + 2 * r1 * r2 * c); };
  const auto exact = values_of(whole->design, [&](const auto& u) { return height(40 + 20 * u[0], 20 + 10 * u[1]); });
  const GlobalSensitivity wanted = global_sensitivity(whole->design, exact);
  for (std::size_t i = 0; i < 2; ++i) EXPECT_NEAR(whole->of[1].first[i].value, wanted.first[i].value, 1e-6);
  // Again: nothing is computed, the search's own rows are none of it, and the reader has it too.
  const auto again = study_sensitivity(s, *store, SensitivityMethod::morris, 60, 1, options);
  ASSERT_TRUE(again);
  EXPECT_EQ(again->computed, 0);
  EXPECT_EQ(store->rows()->size(), 0U);
  ASSERT_TRUE(store->close());
  const auto read = Store::read(folder / "a");
  ASSERT_TRUE(read) << to_string(read.error());
  const auto kept = kept_sensitivity(read->study(), *read);
  ASSERT_TRUE(kept) << to_string(kept.error());
  EXPECT_EQ(kept->design.points, whole->design.points);
  EXPECT_EQ(kept->of[1].total[0].upper, whole->of[1].total[0].upper);
}

}  // namespace
}  // namespace polypod::design
