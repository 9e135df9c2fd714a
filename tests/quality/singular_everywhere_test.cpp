// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Machines that are singular at every pose, and machines that only look like it.
#include <gtest/gtest.h>

#include <Eigen/SVD>
#include <random>
#include <string>

#include "machines.hpp"
#include "paths.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/quality/singularity.hpp"

namespace polypod::quality {
namespace {

machine::AnyMachine trial(const std::string& name, const std::vector<machine::Override>& sets = {}) {
  return test::load(test::source("tests/trials/" + name), sets);
}

/// Six points of no conic: the machine has parallel legs at home, and a regular platform where that is turned.
machine::AnyMachine parallel_at_home() {
  return *machine::from_text(R"(
family = "strut-hexapod"
base = { joints_mm = [[50,0,0],[25,43,0],[-5,20,0],[-50,0,0],[-25,-43,0],[25,-43,0]] }
platform = { joints_mm = [[50,0,0],[25,43,0],[-5,20,0],[-50,0,0],[-25,-43,0],[25,-43,0]] }
leg = { length_min_mm = 50, length_max_mm = 90 }
)",
                             "parallel_at_home.toml");
}

/// The smallest singular value of the six leg lines [w; e x w], e in units of 0.1 m, by their
/// own formula: the oracle.
double least_of_leg_lines(const machine::StrutHexapod& m, const Pose& X) {
  Mat6 lines;
  for (int i = 0; i < 6; ++i) {
    const auto k = static_cast<std::size_t>(i);
    const Vec3 end = X.R * (m.platform_joint[k] - Vec3(0, 0, m.tool_length));
    const Vec3 w = (X.p + end - m.base_joint[k]).normalized();
    lines.row(i) << w.transpose(), (10 * end).cross(w).transpose();
  }
  return Eigen::JacobiSVD<Mat6>(lines).singularValues()[5];
}

/// The largest of the smallest singular values over random poses, limits or not.
double largest_least(const machine::AnyMachine& any) {
  const auto& m = std::get<machine::StrutHexapod>(any);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> unit(-1, 1);
  double out = 0;
  for (int k = 0; k < 200; ++k) {
    const Vec3 turn(unit(random), unit(random), unit(random)), p(unit(random), unit(random), 2 + unit(random));
    out = std::max(out, least_of_leg_lines(m, {rotation_of(turn), 0.05 * p}));
  }
  return out;
}

TEST(SingularEverywhere, CongruentAndRegularHexagons) {
  for (const machine::AnyMachine& m :
       {trial("congruent.toml"), trial("regular_hexagons.toml"), test::congruent(),
        trial("regular_hexagons.toml", {{"base.radius_mm", "61"}, {"platform.radius_mm", "31"}})}) {
    ASSERT_LT(largest_least(m), 1e-12);  // rounding
    const PoseIndependentSingularity s = pose_independent_singularity(m);
    EXPECT_EQ(s.poses, 33);
    EXPECT_EQ(s.type2, 33);
    EXPECT_GE(s.within_limits, 2);
    EXPECT_TRUE(s.never_held() && s.everywhere());
    EXPECT_FALSE(s.nearly());
    const std::string words = in_words(s);
    EXPECT_NE(words.find("at 33 of 33 poses"), std::string::npos) << words;
    EXPECT_NE(words.find("type 2"), std::string::npos) << words;
  }
}

TEST(SingularEverywhere, ALinearDeltaWhoseRodsAreNearlyParallel) {
  // With platform joints as far out as the rails every rod would be (x, y, -sqrt(l^2 - x^2 - y^2)): the reader refuses
  // that machine, because it has no home, but one 0.01 mm away from it stands.
  const auto delta = [](const char* platform_mm) {
    return *machine::from_text(std::string("family = \"linear-delta\"\nbase = { radius_mm = 125 }\nplatform = { "
                                           "radius_mm = ") +
                                   platform_mm + " }\nrail = { length_mm = 450 }\nrod = { length_mm = 215 }\n",
                               "delta.toml");
  };
  const PoseIndependentSingularity s = pose_independent_singularity(delta("124.99"));
  EXPECT_FALSE(s.everywhere());
  EXPECT_TRUE(s.nearly());
  // Rods differ by 0.01 mm in 215 mm across: so does the smallest singular value, but for a factor of the triangle.
  EXPECT_NEAR(s.largest_control / (0.01 / 215), 1, 0.5);
  EXPECT_EQ(in_words(pose_independent_singularity(delta("33"))), "");
}

TEST(SingularEverywhere, NearlyIsNotSingularAndIsSaid) {
  const machine::AnyMachine m = trial("regular_hexagons.toml", {{"platform.pair_angle_deg", "60.01"}});
  const double oracle = largest_least(m);
  ASSERT_GT(oracle, 1e-8);
  ASSERT_LT(oracle, 1e-3);
  const PoseIndependentSingularity s = pose_independent_singularity(m);
  EXPECT_EQ(s.type2, 0);
  EXPECT_FALSE(s.everywhere());
  EXPECT_TRUE(s.nearly());
  EXPECT_NE(in_words(s).find("close to singular at 33 of 33 poses"), std::string::npos) << in_words(s);

  const PoseIndependentSingularity far =
      pose_independent_singularity(trial("regular_hexagons.toml", {{"platform.pair_angle_deg", "100"}}));
  EXPECT_FALSE(far.everywhere() || far.nearly());
  EXPECT_EQ(in_words(far), "");
}

TEST(SingularEverywhere, SingularAtHomeAlone) {
  const machine::AnyMachine m = parallel_at_home();
  const auto& strut = std::get<machine::StrutHexapod>(m);
  ASSERT_LT(least_of_leg_lines(strut, {Mat3::Identity(), Vec3(0, 0, 0.07)}), 1e-12);
  ASSERT_GT(largest_least(m), 1e-3);
  const PoseIndependentSingularity s = pose_independent_singularity(m);
  EXPECT_EQ(s.type2, 1);
  EXPECT_FALSE(s.everywhere() || s.nearly());
}

TEST(SingularEverywhere, NoMachineOfTheCatalogue) {
  for (const machine::CatalogueEntry& entry : machine::catalogue()) {
    const PoseIndependentSingularity s = pose_independent_singularity(test::load(std::string(entry.name)));
    EXPECT_EQ(s.poses, 33) << entry.name;
    EXPECT_GE(s.within_limits, 30) << entry.name;
    EXPECT_FALSE(s.everywhere() || s.nearly()) << entry.name << ": " << in_words(s);
  }
}

TEST(SingularEverywhere, AnArmWithTwoJointsOnOneAxis) {
  const auto arm = [](const char* a_mm) {
    return *machine::from_text(std::string("family = \"serial\"\ntask = \"point\"\nconvention = \"standard\"\ndh = "
                                           "[{a_mm = ") +
                                   a_mm +
                                   ", alpha_deg = 0, d_mm = 100}, {a_mm = 200, alpha_deg = 0, d_mm = 0}, {a_mm = 0, "
                                   "alpha_deg = 0, d_mm = 0, joint = \"prismatic\"}]\nlimits = [{min_deg = -170, "
                                   "max_deg = 170}, {min_deg = -150, max_deg = 150}, {min_mm = -50, max_mm = 50}]\n",
                               "arm.toml");
  };
  const PoseIndependentSingularity s = pose_independent_singularity(arm("0"));
  EXPECT_TRUE(s.never_moves_freely());
  EXPECT_FALSE(s.never_held());
  EXPECT_FALSE(pose_independent_singularity(arm("200")).everywhere());
}

}  // namespace
}  // namespace polypod::quality
