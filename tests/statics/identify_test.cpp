// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/statics/identify.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <filesystem>
#include <numbers>
#include <random>

#include "paths.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"
#include "polypod/statics/judge.hpp"

namespace polypod::statics {
namespace {

const machine::AnyMachine& lola() {
  static const machine::AnyMachine m = *machine::load("lola50");
  return m;
}
constexpr double kTable4_4[5] = {9.03e-7, 11.17e-7, 14.74e-7, 27.65e-7, 97.58e-7};

std::string data(const std::string& name) {
  return test::source("tests/statics/data/" + name);
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

/// The asymmetry of the cross displacements tells the noise of a reading where the forces differ from axis to axis,
/// too.
TEST(Identify, NoiseUnderUnequalForces) {
  const double c[] = {1e-6, 2e-6, 2e-6, 4e-6, 4e-6};
  constexpr double kNoise = 5e-6;
  std::mt19937 random(5);
  std::normal_distribution<double> normal(0, kNoise);
  auto points = synthetic(c, 0, random);
  for (MeasuredPoint& p : points) {
    const Mat3 C = p.displacement / p.force;
    p.own_forces = Vec3(400, 400, 50);
    p.force = 400;
    p.displacement = p.computed(C);
    for (double& x : p.displacement.reshaped()) x += normal(random);
  }
  const auto r = identify_compliance(lola(), points);
  ASSERT_TRUE(r) << to_string(r.error());
  EXPECT_NEAR(r->noise, kNoise, 0.15 * kNoise);  // of 270 differences: 4 % is one standard deviation
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

/// A six-axis arm whose spindle stands in line with the flange: joint 6 turns about the tool axis.
machine::AnyMachine arm_in_line(const std::string& tool) {
  return *machine::from_text(R"(
name = "arm in line"
family = "serial"
convention = "standard"
dh = [
  { a_mm = 320, alpha_deg = -90, d_mm = 780 },
  { a_mm = 1125, alpha_deg = 0, d_mm = 0, theta_offset_deg = -90 },
  { a_mm = 200, alpha_deg = -90, d_mm = 0 },
  { a_mm = 0, alpha_deg = 90, d_mm = 1142.5 },
  { a_mm = 0, alpha_deg = -90, d_mm = 0 },
  { a_mm = 0, alpha_deg = 0, d_mm = 200, theta_offset_deg = 180 },
]
limits = [
  { min_deg = -170, max_deg = 170 },
  { min_deg = -65, max_deg = 85 },
  { min_deg = -180, max_deg = 70 },
  { min_deg = -300, max_deg = 300 },
  { min_deg = -130, max_deg = 130 },
  { min_deg = -360, max_deg = 360 },
]
compliance_rad_per_Nm = [2.63e-7, 1.51e-7, 2.56e-7, 17.9e-7, 15.2e-7, 21.3e-7]
tool = { )" + tool + " }\n",
                             "arm.toml");
}

// Joint 6 then moves the tip by its rounding alone, or by nanometres: the readings say nothing of it. (Its estimate was
// 1e23 rad/Nm, with a yes.)
TEST(Identify, AJointWhoseAxisPassesTheTipStaysAsItWas) {
  for (const char* tool : {"z_mm = 350, a_deg = 180", "x_mm = 0.001, z_mm = 350, a_deg = 180"}) {
    const machine::AnyMachine nominal = arm_in_line(tool);
    const std::vector<double> truth{3e-7, 1.2e-7, 2.2e-7, 20e-7, 14e-7, 30e-7};
    const machine::AnyMachine real = *with_compliances(nominal, truth);
    std::mt19937 random(3);
    std::normal_distribution<double> normal(0, 5e-6);
    std::uniform_real_distribution<double> place(-0.3, 0.3);
    std::vector<MeasuredPoint> points;
    while (points.size() < 30) {
      MeasuredPoint p;
      p.X_MT = {rotation_abc(place(random), place(random), place(random)) * rotation_x(std::numbers::pi),
                Vec3(1.5 + place(random), place(random), 0.8 + place(random))};
      p.force = 250;
      const Compliance c = compliance_at(real, p.X_MT);
      if (!c.reachable) continue;
      p.displacement = c.linear() * p.force;
      for (double& x : p.displacement.reshaped()) x += normal(random);
      points.push_back(p);
    }
    const auto r = identify_compliance(nominal, points);
    ASSERT_TRUE(r) << to_string(r.error());
    EXPECT_THAT(r->told, testing::ElementsAre(true, true, true, true, true, false));
    EXPECT_EQ(r->compliance[5], 21.3e-7);
    EXPECT_TRUE(std::isnan(r->standard_error[5]));
    for (std::size_t i = 0; i < 5; ++i) EXPECT_NEAR(r->compliance[i], truth[i], 4 * r->standard_error[i]) << i;
    const Verdict verdict = verdict_of(*r, judge(nominal, points));
    EXPECT_EQ(verdict.answer, Verdict::Answer::in_part);
    EXPECT_THAT(verdict.why, testing::HasSubstr("The compliance of joint 6 is not identifiable"));
    EXPECT_DOUBLE_EQ(r->covariance(5, 5), 21.3e-7 * 21.3e-7);
    // Of a machine without compliances so far nothing is known of it, which is not that it is rigid.
    const auto first = identify_compliance(*with_compliances(nominal, std::vector<double>(6, 0)), points);
    ASSERT_TRUE(first) << to_string(first.error());
    ASSERT_FALSE(first->told[5]);
    EXPECT_EQ(first->compliance[5], 0);
    const double largest = *std::max_element(first->compliance.begin(), first->compliance.end());
    EXPECT_DOUBLE_EQ(first->covariance(5, 5), largest * largest);
  }
}

// Rows with a standard deviation each count by it: the intervals become those of the good rows, and hold the truth.
TEST(Identify, RowsCountByTheirStandardDeviations) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal(0, 1);
  double of_weighted = 0, of_equal = 0;
  int held = 0, all = 0;
  for (int trial = 0; trial < 40; ++trial) {
    std::vector<MeasuredPoint> points = synthetic(kTable4_4, 0, random);
    for (std::size_t i = 0; i < points.size(); ++i) {
      points[i].sigma = i % 2 == 0 ? 2e-6 : 40e-6;
      for (double& x : points[i].displacement.reshaped()) x += points[i].sigma * normal(random);
    }
    const auto weighted = identify_compliance(lola(), points);
    for (MeasuredPoint& p : points) p.sigma = 0;
    const auto equal = identify_compliance(lola(), points);
    ASSERT_TRUE(weighted && equal);
    for (std::size_t i = 0; i < 5; ++i) {
      of_weighted += weighted->standard_error[i];
      of_equal += equal->standard_error[i];
      held += std::abs(weighted->compliance[i] - kTable4_4[i]) <= weighted->half_interval[i] ? 1 : 0;
      ++all;
    }
  }
  EXPECT_LT(of_weighted, 0.15 * of_equal);  // sqrt 2 * 2 um against the rms of 2 and 40 um, 28 um: a tenth
  EXPECT_GT(held, 0.9 * all);
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
