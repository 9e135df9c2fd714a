// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/statics/identify.hpp"

#include <gmock/gmock.h>

#include <filesystem>
#include <random>

#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"

namespace polypod::statics {
namespace {

const machine::AnyMachine& lola() {
  static const machine::AnyMachine m = *machine::load("lola50");
  return m;
}
constexpr double kTable4_4[5] = {9.03e-7, 11.17e-7, 14.74e-7, 27.65e-7, 97.58e-7};

std::string data(const std::string& name) {
  return std::string(POLYPOD_TEST_DATA) + "/statics/data/" + name;
}

std::vector<MeasuredPoint> both_planes() {
  std::vector<MeasuredPoint> points;
  for (const char* name : {"displacements_plane_I.csv", "displacements_plane_V.csv"}) {
    auto more = read_displacements(data(name));
    EXPECT_TRUE(more) << (more ? "" : to_string(more.error()));
    points.insert(points.end(), more->begin(), more->end());
  }
  return points;
}

/// Points of the source's plan with what the model says, and noise.
std::vector<MeasuredPoint> synthetic(const double* c, double noise, std::mt19937& random) {
  std::normal_distribution<double> normal(0, noise);
  std::vector<MeasuredPoint> points;
  for (int plane = 0; plane < 6; ++plane)
    for (int row = 0; row < 3; ++row)
      for (int column = 0; column < 5; ++column) {
        MeasuredPoint p;
        p.X_MT.p = Vec3(-0.6 + 0.3 * column, -1.6 + 0.3 * row, -0.4 + 0.1 * plane);
        p.force = 250;
        const auto q = kinematics::inverse(lola(), p.X_MT).reachable()->joints;
        const auto shares = unit_compliances(lola(), p.X_MT, q);
        for (std::size_t k = 0; k < shares.size(); ++k) p.displacement += c[k] * 250 * shares[k];
        for (double& x : p.displacement.reshaped()) x += noise > 0 ? normal(random) : 0.0;
        points.push_back(p);
      }
  return points;
}

// SLAV Table 4.4 is from all 90 points; planes I and V are 30 of them.
TEST(Identify, PlanesIAndVGiveTable4_4) {
  const auto r = identify_compliance(lola(), both_planes());
  ASSERT_TRUE(r) << to_string(r.error());
  EXPECT_EQ(r->equations, 270u);
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_NEAR(r->compliance[i], kTable4_4[i], 2 * r->standard_error[i]) << "joint " << i + 1;
  }
  EXPECT_NEAR(units::to_um(r->residual_rms), 33, 2);
  EXPECT_LT(r->condition, 100);
}

TEST(Identify, ResidualsAreThoseOfTheMachineThatItGives) {
  const auto r = identify_compliance(lola(), both_planes());
  const auto measured = with_compliances(lola(), r->compliance);
  ASSERT_TRUE(measured);
  EXPECT_NEAR(*prediction_rms(*measured, both_planes()), r->residual_rms, 1e-12);
  EXPECT_GE(*prediction_rms(lola(), both_planes()), r->residual_rms);
}

// The struts of a hexapod each have their own: the same code tells them.
TEST(Identify, EachLegOfAHexapod) {
  const machine::AnyMachine nominal = *machine::load("hexapod-strut", {{"leg.compliance_um_per_N", "0.05"}});
  const std::vector<double> truth{4e-8, 5e-8, 6e-8, 4.5e-8, 5.5e-8, 7e-8};
  const machine::AnyMachine real = *with_compliances(nominal, truth);
  std::vector<MeasuredPoint> points;
  for (int k = 0; k < 12; ++k) {
    MeasuredPoint p;
    p.X_MT = Pose{rotation_of(0.1 * Vec3(std::sin(k), std::cos(k), 0)),
                  Vec3(4e-3 * std::cos(2 * k), 4e-3 * std::sin(2 * k), 74e-3 + 1e-3 * (k % 3))};
    p.force = 100;
    p.displacement = compliance_at(real, p.X_MT).linear() * p.force;
    points.push_back(p);
  }
  const auto r = identify_compliance(nominal, points);
  ASSERT_TRUE(r) << to_string(r.error());
  for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(r->compliance[i], truth[i], 1e-9 * truth[i]);
  const auto file = machine::from_text(machine::to_toml(*with_compliances(nominal, r->compliance)), "measured.toml");
  ASSERT_TRUE(file);
  for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(column_compliances(*file)[i], truth[i], 1e-9 * truth[i]);
}

// A delta's drives in rad/Nm and its parallelograms in m/N side by side.
TEST(Identify, EachDriveAndRodOfADelta) {
  const machine::AnyMachine nominal =
      *machine::load("delta-picker", {{"drive.compliance_rad_per_Nm", "1e-5"}, {"rod.compliance_um_per_N", "0.2"}});
  const std::vector<double> truth{1.0e-5, 1.2e-5, 0.8e-5, 0.2e-6, 0.25e-6, 0.15e-6};
  const machine::AnyMachine real = *with_compliances(nominal, truth);
  std::vector<MeasuredPoint> points;
  for (int k = 0; k < 12; ++k) {
    MeasuredPoint p;
    p.X_MT.p = Vec3(0.3 * std::cos(2.0 * k), 0.3 * std::sin(2.0 * k), 0.75 + 0.05 * (k % 4));
    p.force = 50;
    const Compliance c = compliance_at(real, p.X_MT);
    ASSERT_TRUE(c.reachable) << c.reason;
    p.displacement = c.linear() * p.force;
    points.push_back(p);
  }
  const auto r = identify_compliance(nominal, points);
  ASSERT_TRUE(r) << to_string(r.error());
  EXPECT_THAT(r->joint, testing::ElementsAre("drive 1", "drive 2", "drive 3", "rod 1", "rod 2", "rod 3"));
  EXPECT_THAT(r->turns, testing::ElementsAre(true, true, true, false, false, false));
  for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(r->compliance[i], truth[i], 1e-7 * truth[i]);
  const auto file = machine::from_text(machine::to_toml(*with_compliances(nominal, r->compliance)), "measured.toml");
  ASSERT_TRUE(file) << to_string(file.error());
  for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(column_compliances(*file)[i], truth[i], 1e-7 * truth[i]);
  EXPECT_THAT(column_turns(*machine::load("delta-linear")), testing::Each(false));
}

TEST(Identify, DisplacementsAgainstTheForcesAreRefused) {
  auto points = both_planes();
  for (MeasuredPoint& p : points) p.displacement = -p.displacement;
  const auto r = identify_compliance(lola(), points);
  ASSERT_FALSE(r);
  EXPECT_EQ(r.error().id, "ID116");
}

TEST(Identify, AskewReadingsAndPosesThatTellTooLittleAreNamed) {
  std::mt19937 random(6);
  auto points = synthetic(kTable4_4, 5e-6, random);
  EXPECT_TRUE(identify_compliance(lola(), points)->symmetric);
  for (MeasuredPoint& p : points) p.displacement(0, 1) += 100e-6;
  EXPECT_FALSE(identify_compliance(lola(), points)->symmetric);
  const auto hardly = identify_compliance(lola(), both_planes())->hardly_apart;
  EXPECT_THAT(hardly, testing::Contains(std::pair<int, int>(0, 3)));
  const std::vector<MeasuredPoint> one(6, points[7]);  // at x = 0 joints 1 and 4 give way in the same direction
  const auto r = identify_compliance(lola(), one);
  ASSERT_FALSE(r);
  EXPECT_EQ(r.error().id, "ID112");
  EXPECT_THAT(r.error().message, testing::HasSubstr("joint"));
}

TEST(Identify, ExactDataGiveExactCompliances) {
  std::mt19937 random(1);
  const auto r = identify_compliance(lola(), synthetic(kTable4_4, 0, random));
  ASSERT_TRUE(r);
  for (std::size_t i = 0; i < 5; ++i) EXPECT_NEAR(r->compliance[i], kTable4_4[i], 1e-12 * kTable4_4[i] + 1e-18);
}

// 1000 trials of 90 points with 5 um noise: each 95 % interval covers the truth in 95 % of them; 3 % is four standard
// deviations of the count.
TEST(Identify, IntervalsCoverTheTruth) {
  std::mt19937 random(20260911);
  int covered[5] = {};
  constexpr int kTrials = 1000;
  for (int trial = 0; trial < kTrials; ++trial) {
    const auto r = identify_compliance(lola(), synthetic(kTable4_4, 5e-6, random));
    ASSERT_TRUE(r);
    for (std::size_t i = 0; i < 5; ++i) covered[i] += std::abs(r->compliance[i] - kTable4_4[i]) <= r->half_interval[i];
  }
  for (const int n : covered) EXPECT_NEAR(n / double(kTrials), 0.95, 0.03);
}

TEST(Identify, CompliancesAreNeverNegative) {
  double c[5] = {9e-7, 0, 14e-7, 0, 97e-7};
  std::mt19937 random(3);
  bool held = false;
  for (int trial = 0; trial < 20; ++trial) {
    const auto r = identify_compliance(lola(), synthetic(c, 30e-6, random));
    ASSERT_TRUE(r);
    for (std::size_t i = 0; i < 5; ++i) {
      EXPECT_GE(r->compliance[i], 0);
      held = held || r->compliance[i] == 0;
    }
  }
  EXPECT_TRUE(held);
}

TEST(Identify, OutliersAreFlaggedAndKept) {
  std::mt19937 random(4);
  auto points = synthetic(kTable4_4, 5e-6, random);
  points[17].displacement(1, 2) += 400e-6;
  const auto r = identify_compliance(lola(), points);
  ASSERT_TRUE(r);
  const auto found = std::find_if(r->outliers.begin(), r->outliers.end(), [](const Outlier& x) {
    return x.point == 17 && x.direction == 1 && x.force_axis == 2;
  });
  ASSERT_NE(found, r->outliers.end());
  EXPECT_EQ(r->equations, 810u);
}

TEST(Identify, BadFilesAreNamedWithTheirLine) {
  const std::string header =
      "# "
      "remark\nx_mm,y_mm,z_mm,force_N,dx_Fx_um,dy_Fx_um,dz_Fx_um,dx_Fy_um,dy_Fy_um,dz_Fy_um,dx_Fz_um,dy_Fz_um,dz_Fz_"
      "um\n";
  const std::string row = "0,-1300,0,250,489,6,23,28,637,-284,-45,-322,897\n";
  const struct {
    std::string text;
    const char* id;
    int line;
  } cases[] = {
      {"x_mm,y_mm\n1,2\n", "ID100", 1},
      {header + "0,-1300,0,250,abc,6,23,28,637,-284,-45,-322,897\n", "ID101", 3},
      {header + "0,-1300,0,250,489,6\n", "ID101", 3},
      {header, "ID102", 0},
      {header + row + row, "ID103", 4},
      {header + "0,-1300,0,0,489,6,23,28,637,-284,-45,-322,897\n", "ID104", 3},
      {header + "0,-1300,0,250,489000,6000,23000,28000,637000,-284000,-45000,-322000,897000\n", "ID105", 3},
  };
  const std::string path = std::filesystem::temp_directory_path() / ("polypod-identify-" + std::to_string(::getpid()));
  for (const auto& c : cases) {
    ASSERT_TRUE(files::write_whole(path, c.text));
    const auto r = read_displacements(path);
    ASSERT_FALSE(r) << c.id;
    EXPECT_EQ(r.error().id, c.id);
    EXPECT_EQ(r.error().place.line, c.line) << c.id;
  }
  std::filesystem::remove(path);
}

TEST(Identify, TooFewOrOutOfReachPoints) {
  EXPECT_EQ(identify_compliance(lola(), {}).error().id, "ID110");
  std::mt19937 random(5);
  auto points = synthetic(kTable4_4, 0, random);
  points[3].X_MT.p = Vec3(0, -5, 0);
  EXPECT_EQ(identify_compliance(lola(), points).error().id, "ID111");
}

}  // namespace
}  // namespace polypod::statics
