// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Numbers in the wrong unit are named; usual ones are left alone.
#include "polypod/cutting/plausibility.hpp"

#include <gtest/gtest.h>

#include "samples.hpp"

namespace polypod::cutting {
namespace {

using samples::aluminium;
using samples::end_mill;

constexpr double kFeed = 0.05e-3;  // m a tooth
constexpr double kSpeed = 8000 / 60.0;

std::vector<std::string> notes(double feed, double speed, const Material& material = aluminium(),
                               const Cutter& cutter = end_mill()) {
  return plausibility(cutter, material, feed, speed);
}

void expect_one(const std::vector<std::string>& found, const std::string& part) {
  ASSERT_EQ(found.size(), 1u);
  EXPECT_NE(found[0].find(part), std::string::npos) << found[0];
}

Material published(double ktc, double krc, double kac, double kte, double kre, double kae) {
  Material m;
  m.ktc = units::from_N_per_mm2(ktc), m.krc = units::from_N_per_mm2(krc), m.kac = units::from_N_per_mm2(kac);
  m.kte = units::from_N_per_mm(kte), m.kre = units::from_N_per_mm(kre), m.kae = units::from_N_per_mm(kae);
  return m;
}

TEST(Plausibility, UsualCutsHaveNoNotes) {
  EXPECT_TRUE(notes(kFeed, kSpeed).empty());
  EXPECT_TRUE(notes(0, 0).empty());  // nothing to judge but the coefficients
  // Published sets (doi 10.1186/s10033-021-00536-9, table 5): aluminium 6082, 7075, 7075 with a tool of high-speed
  // steel.
  EXPECT_TRUE(notes(kFeed, kSpeed, published(631, 99, 273, 13, 10, 2.8)).empty());
  EXPECT_TRUE(notes(kFeed, kSpeed, published(1319.41, 788.83, 48.75, 19.65, 26.77, 2.05)).empty());
  EXPECT_TRUE(notes(kFeed, kSpeed, published(951.365, 262.597, 323.33, 11.115, 11.314, 1.105)).empty());
  EXPECT_TRUE(notes(kFeed, kSpeed, published(2500, 1200, -800, 60, 60, -10)).empty());
  const Cutter small{"0.4 mm", 0.4e-3, 2, 0.5, 2e-3};
  EXPECT_TRUE(notes(3e-6, 1000, aluminium(), small).empty());  // micro milling at 60 000 rev/min
}

TEST(Plausibility, FeedAboveAFifthOfTheDiameter) {
  EXPECT_TRUE(notes(0.199 * 8e-3, kSpeed).empty());
  expect_one(notes(0.201 * 8e-3, kSpeed), "more than a fifth");
  expect_one(notes(1.27e-3 * 1.5, kSpeed), "G20");                    // 0.075 mm, read as inches
  expect_one(notes(0.3e-3 * 60 / (2 * samples::kPi), 800), "rad/s");  // S 838 for 8000
  expect_one(notes(0.05e-3 * 60, kSpeed / 60), "rev/min");
  expect_one(notes(1, kSpeed), "in the right unit");
}

TEST(Plausibility, FeedThinnerThanAnEdge) {
  EXPECT_TRUE(notes(0.21e-6, kSpeed).empty());
  expect_one(notes(0.05e-6, kSpeed), "m/min instead of mm/min");
  const Cutter small{"0.4 mm", 0.4e-3, 2, 0.5, 2e-3};
  expect_one(notes(0.19e-6, 1000, aluminium(), small), "inch/min");
}

TEST(Plausibility, CuttingSpeedAbove3000MetresAMinute) {
  const double limit = 50 / (samples::kPi * 8e-3);
  EXPECT_TRUE(notes(kFeed, 0.999 * limit).empty());
  expect_one(notes(kFeed, 1.001 * limit), "3000 m/min");
  Cutter in_um = end_mill();
  in_um.diameter = 8;  // diameter_mm = 8000
  expect_one(notes(kFeed, kSpeed, aluminium(), in_um), "diameter_mm in um");
}

TEST(Plausibility, CoefficientsInTheWrongUnit) {
  Material m = aluminium();
  m.ktc *= 1e6;  // 1.03e9 written where N/mm^2 belong
  expect_one(notes(kFeed, kSpeed, m), "N/m^2");
  m = aluminium();
  m.ktc *= 145.038;
  expect_one(notes(kFeed, kSpeed, m), "psi");
  m = aluminium();
  m.ktc *= 1e-3;
  expect_one(notes(kFeed, kSpeed, m), "GPa");
  m = aluminium();
  m.kre *= 1e3;
  expect_one(notes(kFeed, kSpeed, m), "N/m instead of N/mm");
  m = aluminium();
  m.krc *= 1e-3;
  expect_one(notes(kFeed, kSpeed, m), "Krc of 0.182 N/mm^2 is outside");
  m = aluminium();
  m.kte *= 1e-3;
  expect_one(notes(kFeed, kSpeed, m), "kN/mm instead of N/mm");
  m = aluminium();
  m.kre = -m.kre;
  expect_one(notes(kFeed, kSpeed, m), "Kre of -27.95 N/mm is negative");
  m = aluminium();
  m.kac *= -1e6;
  expect_one(notes(kFeed, kSpeed, m), "Kac");
  m = aluminium();
  m.end = EndCoefficients{m.ktc, m.krc, m.kac * 1e6, m.kte, m.kre, m.kae};
  expect_one(notes(kFeed, kSpeed, m), "end: Kac");
}

TEST(Plausibility, AnExponentIsTakenAtTheChip) {
  // Kienzle, k_c1.1 = 1700 N/mm^2, m_c = 0.25: K_tc = 1700 N/mm^1.75.
  Material m = published(0, 400, 300, 0, 0, 0);
  m.exponent = 0.75;
  const double to_si = 1e3 * std::pow(1e3, 0.75);
  m.ktc = 1700 * to_si, m.krc = 400 * to_si, m.kac = 300 * to_si;
  EXPECT_TRUE(notes(kFeed, kSpeed, m).empty());
  m.ktc *= 1e6;
  expect_one(notes(kFeed, kSpeed, m), "N/m^2");
}

}  // namespace
}  // namespace polypod::cutting
