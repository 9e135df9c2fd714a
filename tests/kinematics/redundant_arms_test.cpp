// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Arms whose task leaves one freedom open: what they take within their limits is found, and in which branch.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "machines.hpp"
#include "polypod/core/units.hpp"
#include "polypod/families/serial/kinematics.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/posture.hpp"

namespace polypod {
namespace {

using machine::JointVector;
using machine::SerialArm;
using test::arm_of;

struct Named {
  const char* name;
  SerialArm arm;
};

// The arm of a KUKA KR 210 on a rail that is inclined, behind a row that is locked.
constexpr const char* kRail = R"(
family = "serial"
convention = "modified"
base = { x_mm = 200, b_deg = 80, c_deg = 20 }
dh = [ { d_mm = 40 }, { joint = "prismatic", theta_offset_deg = 90, sign = -1 }, { alpha_deg = -90, d_mm = 675, sign = -1 },
       { a_mm = 350, alpha_deg = -90 }, { a_mm = 1150, theta_offset_deg = -90 },
       { a_mm = -41, alpha_deg = -90, d_mm = 1200, sign = -1 }, { alpha_deg = 90 },
       { alpha_deg = -90, d_mm = 215, theta_offset_deg = 180, sign = -1 } ]
locked = { 1 = 25 }
tool = { z_mm = 150, a_deg = 180 }
limits = [ { min_mm = -2000, max_mm = 2000 }, { min_deg = -185, max_deg = 185 }, { min_deg = -140, max_deg = -5 },
           { min_deg = -120, max_deg = 155 }, { min_deg = -350, max_deg = 350 }, { min_deg = -125, max_deg = 125 },
           { min_deg = -350, max_deg = 350 } ]
)";
// A turntable that the arm stands beside, standard table.
constexpr const char* kTurntable = R"(
family = "serial"
dh = [ { a_mm = 800, d_mm = 300, sign = -1, theta_offset_deg = 15 }, { a_mm = 260, alpha_deg = 90, d_mm = 700 },
       { a_mm = 980, theta_offset_deg = 90 }, { a_mm = 145, alpha_deg = 90 }, { alpha_deg = -90, d_mm = 1010 },
       { alpha_deg = 90 }, { d_mm = 190 } ]
tool = { x_mm = 30, z_mm = 250, a_deg = 180 }
limits = [ { min_deg = -170, max_deg = 170 }, { min_deg = -60, max_deg = 60 }, { min_deg = -60, max_deg = 75 },
           { min_deg = -90, max_deg = 70 }, { min_deg = -200, max_deg = 200 }, { min_deg = -120, max_deg = 120 },
           { min_deg = -200, max_deg = 200 } ]
)";

std::vector<Named> arms() {
  SerialArm free_turn = std::get<SerialArm>(test::load("abb-irb6700"));
  free_turn.task = machine::Task::axis;
  SerialArm five = std::get<SerialArm>(test::load("lola50"));
  machine::DhRow rail;
  rail.kind = machine::JointKind::prismatic;
  rail.range = {-1.5, 1.5};
  five.dh.insert(five.dh.begin(), rail);
  five.X_MB = five.X_MB * Pose{rotation_y(0.3), Vec3(0, 0, 0.1)};
  return {
      {"rail", arm_of(kRail)}, {"turntable", arm_of(kTurntable)}, {"free turn", free_turn}, {"five on a rail", five}};
}

/// Somewhere within the limits, every third near one of them.
JointVector somewhere(const SerialArm& arm, std::mt19937& random) {
  std::uniform_real_distribution<double> unit(0, 1);
  JointVector q(arm.free_joints());
  for (int i = 0; i < arm.free_joints(); ++i) {
    const machine::JointRange range = joint_range(arm, i);
    double share = unit(random);
    if (unit(random) < 1.0 / 3) share = share < 0.5 ? 0.002 * share : 1 - 0.002 * share;
    q[i] = range.min + share * (range.max - range.min);
  }
  return q;
}

/// What the task sees of the difference of two poses.
double missed(const SerialArm& arm, const Pose& a, const Pose& b) {
  return arm.task == machine::Task::axis ? (a.p - b.p).norm() + (a.R.col(2) - b.R.col(2)).norm()
                                         : test::difference(a, b);
}

TEST(RedundantArms, WhatIsWithinTheLimitsIsFound) {
  for (const auto& [name, arm] : arms()) {
    SCOPED_TRACE(name);
    const machine::AnyMachine m{arm};
    std::mt19937 random(11);
    for (int trial = 0; trial < 300; ++trial) {
      const JointVector q = somewhere(arm, random);
      const Pose X = machine::forward(arm, q);
      const auto inverse = kinematics::inverse(m, X);
      ASSERT_NE(inverse.reachable(), nullptr) << trial << ": " << q.transpose();
      EXPECT_TRUE(machine::reaches(arm, X, ~kinematics::LimitBits{0})) << trial;
      for (const kinematics::Solution& s : inverse.solutions) {
        EXPECT_LT(missed(arm, machine::forward(arm, s.joints), X), 1e-9);
        if (s.violations != 0) continue;
        for (int i = 0; i < arm.free_joints(); ++i) {
          const machine::JointRange range = joint_range(arm, i);
          EXPECT_GE(s.joints[i], range.min - 1e-9);
          EXPECT_LE(s.joints[i], range.max + 1e-9);
        }
      }
      // Followed from these joints themselves the branch has its name.
      const auto near = kinematics::inverse_near(m, X, q);
      ASSERT_NE(near.reachable(), nullptr);
      EXPECT_LT((near.reachable()->joints - q).cwiseAbs().maxCoeff(), 1e-6);
      EXPECT_LT(near.reachable()->branch, kinematics::kNumericBranch) << q.transpose();
      const std::vector<std::string> names = kinematics::all_postures(m);
      EXPECT_NE(std::find(names.begin(), names.end(), kinematics::posture_of(m, q)), names.end());
    }
  }
}

// Nothing is claimed to be reached that is not: beside the workspace by brute force over the free joint.
TEST(RedundantArms, WhatIsReachedAgreesWithASweepOfTheFreeJoint) {
  const SerialArm arm = arm_of(kRail);
  std::mt19937 random(3);
  std::uniform_real_distribution<double> unit(-1, 1);
  int reached = 0, differ = 0;
  constexpr int kTrials = 300, kPlaces = 4000;
  for (int trial = 0; trial < kTrials; ++trial) {
    const Pose X{rotation_abc(3 * unit(random), 1.5 * unit(random), 3 * unit(random)),
                 Vec3(4.5 * unit(random), 3 * unit(random), 1 + 2 * unit(random))};
    bool swept = false;
    for (int k = 0; k <= kPlaces && !swept; ++k) {
      SerialArm still = arm;
      still.dh[1].locked = -2.0 + 4.0 * k / kPlaces;
      swept = machine::inverse(still, X).reachable() != nullptr;
    }
    const bool found = machine::reaches(arm, X, ~kinematics::LimitBits{0});
    reached += swept;
    differ += swept != found;
    EXPECT_TRUE(swept || !found) << X.p.transpose();
  }
  EXPECT_GT(reached, kTrials / 10);
  EXPECT_LE(differ, 1);  // an interval of the rail of some mm, between two places of 62 mm
}

TEST(RedundantArms, TheFirstChoiceIsFarFromAStraightWrist) {
  const SerialArm arm = arm_of(kRail);
  std::mt19937 random(5);
  int straight = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const Pose X = machine::forward(arm, somewhere(arm, random));
    straight += std::abs(machine::inverse(arm, X).reachable()->joints[5]) < units::from_deg(3);
  }
  EXPECT_LE(straight, 2);
}

}  // namespace
}  // namespace polypod
