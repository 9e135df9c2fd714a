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

machine::AnyMachine arm(const std::string& text) {
  return *machine::from_text("family = \"serial\"\n" + text, "arm.toml");
}

const char* const kScara = R"(task = ["x", "y", "z", "C"]
convention = "standard"
dh = [ { a_mm = 325, d_mm = 300 }, { a_mm = 275, alpha_deg = 180 }, { joint = "prismatic" }, { } ]
tool = { a_deg = 180 }
limits = [ { min_deg = -140, max_deg = 140 }, { min_deg = -145, max_deg = 145 }, { min_mm = 0, max_mm = 210 },
  { min_deg = -360, max_deg = 360 } ]
)";

TEST(SingularEverywhere, NoArmWhoseTaskListsWhatItMoves) {
  const std::string gantry = R"(dh = [ { joint = "prismatic", alpha_deg = 90, theta_offset_deg = 90 },
  { joint = "prismatic", alpha_deg = 90, theta_offset_deg = 90 }, { joint = "prismatic" }, { } ]
limits = [ { min_mm = 0, max_mm = 1000 }, { min_mm = 0, max_mm = 1000 }, { min_mm = 0, max_mm = 500 },
  { min_deg = -180, max_deg = 180 } ]
)";
  for (const std::string& text : {
           std::string(kScara),
           // In a plane, the angle not the fourth coordinate.
           std::string("task = [\"x\", \"y\", \"C\"]\ndh = [ { a_mm = 325 }, { a_mm = 275 }, { a_mm = 100 } ]\n"),
           // No whole position.
           std::string("task = [\"x\", \"y\"]\ndh = [ { a_mm = 325 }, { a_mm = 275 } ]\n"),
           std::string("task = [\"z\"]\ndh = [ { joint = \"prismatic\" } ]\nlimits = [ { min_mm = 0, max_mm = 9 } ]\n"),
           // Turns its tool about M's y; its base turned by 90 deg about z it still changes B alone, but about M's x.
           "task = [\"x\", \"y\", \"z\", \"B\"]\n" + gantry,
           "task = [\"x\", \"y\", \"z\", \"B\"]\nbase = { c_deg = 90 }\n" + gantry,
       }) {
    const machine::AnyMachine m = arm(text);
    const PoseIndependentSingularity s = pose_independent_singularity(m);
    EXPECT_EQ(s.type1, 0) << text;
    EXPECT_EQ(s.type2, 0) << text;
    EXPECT_EQ(in_words(s), "") << text;
  }
}

TEST(SingularArm, OfAScaraWhereItsElbowIsStraight) {
  const machine::AnyMachine m = arm(kScara);
  const double a1 = 0.325, a2 = 0.275;
  const auto at = [&](double elbow) -> JointVector { return (JointVector(4) << 0.3, elbow, 0.05, -0.7).finished(); };
  for (const double elbow : {0.4, 1.5, -2.0}) {
    const JointVector q = at(elbow);
    const Pose X = kinematics::forward(m, q).poses.front();
    const Singularity s = singularity(m, X, q);
    // By hand: the tip's speed over the joints', the third counted on L, the first and the second about upward axes,
    // the fourth about a downward one.
    const Vec3 to_tip = X.p / s.length, forearm = Vec3(std::cos(0.3 + elbow), std::sin(0.3 + elbow), 0) * a2 / s.length;
    Eigen::Matrix4d J;
    J << -to_tip.y(), -forearm.y(), 0, 0,  //
        to_tip.x(), forearm.x(), 0, 0,     //
        0, 0, -1, 0,                       //
        1, 1, 0, -1;
    EXPECT_NEAR(s.mobility, Eigen::JacobiSVD<Eigen::Matrix4d>(J).singularValues()[3], 1e-12) << elbow;
    EXPECT_EQ(s.control, 1);
    EXPECT_EQ(s.kind, 0);
    EXPECT_EQ(in_words(X, s).find("loses"), std::string::npos);

    // The nearest singular pose is the straight arm.
    const auto near = nearest(m, X, q);
    ASSERT_TRUE(near);
    const double reach = near->X_MT.p.head<2>().norm();
    EXPECT_LT(std::min(std::abs(reach - a1 - a2), std::abs(reach - a1 + a2)), 1e-6) << elbow;
  }
  const JointVector q = at(0);
  const Pose X = kinematics::forward(m, q).poses.front();
  const Singularity s = singularity(m, X, q);
  EXPECT_EQ(s.kind, 1);
  EXPECT_LT(s.mobility, 1e-15);
  // It cannot move along itself; the joints that leave the tip where it is turn against each other.
  Vec6 along = Vec6::Zero();
  along.head<3>() = X.p.cwiseProduct(Vec3(1, 1, 0)).normalized() * s.length;
  EXPECT_LT(std::min((s.lost_motion - along).norm(), (s.lost_motion + along).norm()), 1e-12);
  EXPECT_NEAR(s.idle_joints[1] / s.idle_joints[0], -(a1 + a2) / a2, 1e-12);
  EXPECT_NEAR(s.idle_joints[2], 0, 1e-12);
  EXPECT_NEAR(s.idle_joints[3], s.idle_joints[0] + s.idle_joints[1], 1e-12);
}

}  // namespace
}  // namespace polypod::quality
