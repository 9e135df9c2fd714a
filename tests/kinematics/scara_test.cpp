// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// SCARA robots, with the slide in any place: their closed inverse against forward kinematics.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "joints.hpp"
#include "machines.hpp"
#include "polypod/core/units.hpp"
#include "polypod/families/serial/kinematics.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/posture.hpp"

namespace polypod {
namespace {

using machine::JointVector;
using machine::SerialArm;

constexpr const char* kUsual = R"(
family = "serial"
task = ["x", "y", "z", "C"]
base = { x_mm = 30, y_mm = -20, c_deg = 25 }
dh = [ { a_mm = 300, d_mm = 400 }, { a_mm = 250, alpha_deg = 180 }, { joint = "prismatic" }, { d_mm = 50, theta_offset_deg = 10 } ]
tool = { x_mm = 40, y_mm = 15, a_deg = 180, c_deg = 20 }
limits = [ {min_deg=-130,max_deg=130}, {min_deg=-145,max_deg=145}, {min_mm=0,max_mm=180}, {min_deg=-360,max_deg=360} ]
)";
// The slide first (a column), senses exchanged, links off each other's line at 0, a locked row.
constexpr const char* kColumn = R"(
family = "serial"
convention = "modified"
task = ["x", "y", "z", "C"]
dh = [ { joint = "prismatic", sign = -1 }, { sign = -1, theta_offset_deg = 40 }, { a_mm = 325, d_mm = 20 },
       { a_mm = 275, theta_offset_deg = -70, sign = -1 }, { a_mm = 10, alpha_deg = 15 } ]
locked = { 5 = 12 }
tool = { z_mm = 100, a_deg = 30 }
limits = [ {min_mm=-900,max_mm=0}, {min_deg=-170,max_deg=170}, {min_deg=-150,max_deg=150}, {min_deg=-400,max_deg=400}, {min_deg=0,max_deg=20} ]
)";

TEST(Scara, BothElbowsAreFoundWithTheirNames) {
  std::mt19937 random(6);
  for (const char* text : {kUsual, kColumn}) {
    const SerialArm arm = test::arm_of(text);
    ASSERT_TRUE(machine::has_closed_inverse(arm));
    const machine::AnyMachine m{arm};
    for (int trial = 0; trial < 300; ++trial) {
      const JointVector q = test::within_limits(arm, random);
      const Pose X = machine::forward(arm, q);
      // A pose of its task holds no tilt.
      const Pose asked{rotation_abc(0, 0, angles_abc(X.R).z()), X.p};
      const auto inverse = kinematics::inverse(m, asked);
      ASSERT_EQ(inverse.solutions.size(), 2u);
      for (const kinematics::Solution& s : inverse.solutions) {
        const Pose there = machine::forward(arm, s.joints);
        EXPECT_LT((there.p - X.p).norm(), 1e-11);
        EXPECT_LT(std::abs(std::remainder(angles_abc(there.R).z() - angles_abc(X.R).z(), 2 * std::numbers::pi)), 1e-11);
      }
      const auto near = kinematics::inverse_near(m, asked, q);
      ASSERT_NE(near.reachable(), nullptr);
      EXPECT_LT((near.reachable()->joints - q).cwiseAbs().maxCoeff(), 1e-8);
      EXPECT_FALSE(near.reachable()->singular);
    }
    EXPECT_EQ(kinematics::all_postures(m), (std::vector<std::string>{"elbow-positive", "elbow-negative"}));
  }
}

TEST(Scara, BeyondItsLinksAndInLine) {
  const SerialArm arm = test::arm_of(kUsual);
  JointVector q(4);
  q << 0.3, 0, 0.05, 0.2;
  const Pose X = machine::forward(arm, q);
  const auto in_line = machine::inverse(arm, X);
  ASSERT_FALSE(in_line.solutions.empty());
  EXPECT_TRUE(in_line.solutions.front().singular);
  EXPECT_LT((machine::forward(arm, in_line.solutions.front().joints).p - X.p).norm(), 1e-9);
  Pose beyond = X;
  beyond.p += 1e-3 * (X.p - arm.X_MB.p).normalized();
  const auto none = machine::inverse(arm, beyond);
  EXPECT_TRUE(none.solutions.empty());
  EXPECT_NE(none.reason.find("out of reach"), std::string::npos);
}

TEST(Scara, OtherArmsHaveNoSuchForm) {
  SerialArm inclined = test::arm_of(kUsual);
  inclined.X_MB.R = rotation_abc(0.1, 0, 0);
  EXPECT_FALSE(machine::has_closed_inverse(inclined));
  SerialArm two_slides = test::arm_of(kUsual);
  two_slides.dh[1].kind = machine::JointKind::prismatic;
  EXPECT_FALSE(machine::has_closed_inverse(two_slides));
}

}  // namespace
}  // namespace polypod
