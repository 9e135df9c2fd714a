// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Machines with three linear axes and a head: both branches against the forward, against a search that knows nothing of
// heads, on the way over the singular pose; and what a pose leaves open.
#include "polypod/families/serial/cartesian.hpp"

#include <gtest/gtest.h>

#include <numbers>
#include <random>

#include "machines.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/closure.hpp"
#include "polypod/kinematics/free_joints.hpp"

namespace polypod {
namespace {

using machine::CartesianInverse;
using machine::JointKind;
using machine::JointVector;
using machine::SerialArm;
using test::arm_of, test::difference;

constexpr double kPi = std::numbers::pi;
// m and rad: a machine of 2 m, some ten roundings of 2e-16 each.
constexpr double kExact = 1e-12;

constexpr const char* kFork = R"(
family = "serial"
task = "axis"
dh = [ {joint="prismatic", alpha_deg=-90}, {joint="prismatic", alpha_deg=-90, theta_offset_deg=-90}, {joint="prismatic"},
       {alpha_deg=90}, {alpha_deg=-90} ]
base = { b_deg = 90 }
tool = { z_mm = 200, a_deg = 180 }
)";
// A swivel whose axes cross at 45 deg, the tip beside both; linear axes that are not square; a locked row between.
constexpr const char* kNutating = R"(
family = "serial"
task = "axis"
dh = [ {joint="prismatic", alpha_deg=-80, theta_offset_deg=10}, {joint="prismatic", alpha_deg=-95, theta_offset_deg=-90}, {joint="prismatic", sign=-1},
       {alpha_deg=45, a_mm=60, sign=-1, theta_offset_deg=20}, {a_mm=40}, {alpha_deg=-45, d_mm=150, a_mm=35} ]
locked = { 5 = 15 }
base = { b_deg = 90, c_deg = 30, x_mm = 100 }
tool = { z_mm = 120, x_mm = 15, a_deg = 180 }
)";
// Three rotary axes, each square to the next, with offsets between them.
constexpr const char* kThreeAxisHead = R"(
family = "serial"
dh = [ {joint="prismatic", alpha_deg=-90}, {joint="prismatic", alpha_deg=-90, theta_offset_deg=-90}, {joint="prismatic"},
       {alpha_deg=90, a_mm=30}, {alpha_deg=-90, a_mm=25, sign=-1}, {d_mm=90} ]
base = { b_deg = 90 }
tool = { z_mm = 70, y_mm = 20, a_deg = 180 }
)";

struct Named {
  const char* name;
  SerialArm arm;
};
std::vector<Named> machines() {
  return {{"fork", arm_of(kFork)}, {"nutating", arm_of(kNutating)}, {"three-axis head", arm_of(kThreeAxisHead)}};
}

JointVector random_joints(const SerialArm& arm, std::mt19937& random) {
  std::uniform_real_distribution<double> share(-1, 1);
  JointVector q(arm.free_joints());
  for (int i = 0; i < q.size(); ++i) q[i] = share(random) * (i < 3 ? 0.8 : kPi);
  return q;
}

/// Of the whole pose, or the tip and the tool's axis.
double off(const SerialArm& arm, const Pose& a, const Pose& b) {
  if (arm.task == machine::Task::pose) return difference(a, b);
  return std::max((a.p - b.p).cwiseAbs().maxCoeff(), (a.R.col(2) - b.R.col(2)).cwiseAbs().maxCoeff());
}

double apart(const JointVector& a, const JointVector& b) {
  double worst = (a.head<3>() - b.head<3>()).cwiseAbs().maxCoeff();
  for (Eigen::Index i = 3; i < a.size(); ++i) worst = std::max(worst, std::abs(std::remainder(a[i] - b[i], 2 * kPi)));
  return worst;
}

TEST(CartesianInverse, BothBranchesGiveTheirPoseAndOneTheJointsItCameFrom) {
  for (const auto& [name, arm] : machines()) {
    SCOPED_TRACE(name);
    ASSERT_TRUE(CartesianInverse::of(arm));
    EXPECT_TRUE(machine::has_closed_inverse(arm));
    std::mt19937 random(1);
    for (int k = 0; k < 20000; ++k) {
      const JointVector q = random_joints(arm, random);
      const Pose X = machine::forward(arm, q);
      const kinematics::InverseResult found = machine::inverse(arm, X);
      ASSERT_EQ(found.solutions.size(), 2U);
      double nearest = 10;
      for (const kinematics::Solution& s : found.solutions) {
        EXPECT_LT(off(arm, machine::forward(arm, s.joints), X), kExact);
        nearest = std::min(nearest, apart(s.joints, q));
      }
      // Next to the singular pose joints are less certain than the pose, by one over the distance.
      EXPECT_LT(nearest, 1e-8);
    }
  }
}

TEST(CartesianInverse, ASearchThatKnowsNothingOfHeadsFindsTheSame) {
  for (const auto& [name, arm] : machines()) {
    SCOPED_TRACE(name);
    std::mt19937 random(2);
    for (int k = 0; k < 40; ++k) {
      const Pose X = machine::forward(arm, random_joints(arm, random));
      const kinematics::InverseResult closed = machine::inverse(arm, X);
      const kinematics::InverseResult searched = kinematics::inverse_damped(
          arm, X, [&](const JointVector& q) { return machine::forward(arm, q); },
          [&](const Pose& at, const JointVector& q) { return machine::jacobian(arm, at, q); });
      ASSERT_FALSE(searched.solutions.empty());
      for (const kinematics::Solution& s : searched.solutions) {
        const auto same = [&](const kinematics::Solution& c) { return apart(c.joints, s.joints) < 1e-6; };
        EXPECT_TRUE(std::any_of(closed.solutions.begin(), closed.solutions.end(), same)) << k;
      }
    }
  }
}

TEST(CartesianInverse, BranchesAreNamedByTheSideOfTheTilt) {
  const SerialArm arm = arm_of(kFork);
  Pose X;
  X.R = machine::forward(arm, (JointVector(5) << 0, 0, 0, 0.3, 0.5).finished()).R;
  const kinematics::InverseResult found = machine::inverse(arm, X);
  ASSERT_EQ(found.solutions.size(), 2U);
  for (const kinematics::Solution& s : found.solutions) {
    EXPECT_EQ(machine::branch_name(arm, s.branch), s.joints[4] > 0 ? "tilt-positive" : "tilt-negative");
    EXPECT_NEAR(std::abs(s.joints[4]), 0.5, kExact);
    EXPECT_FALSE(s.singular);
  }
}

TEST(CartesianInverse, AtAToolAlongTheFirstRotaryAxisThatIsFreeAndKeepsItsReference) {
  const SerialArm arm = arm_of(kFork);
  const Pose X = machine::forward(arm, (JointVector(5) << 0.1, 0.2, 0.3, 0.7, 0).finished());
  for (const kinematics::Solution& s : machine::inverse(arm, X).solutions) {
    EXPECT_FALSE(s.singular) << "programs of three axes mill there";
    EXPECT_NEAR(s.joints[3], s.branch == 0 ? 0 : kPi, kExact) << "half a turn off in the other";
    EXPECT_EQ(kinematics::free_joints(machine::AnyMachine{arm}, X, s.joints), std::vector<int>{3});
  }
  const JointVector last = (JointVector(5) << 0, 0, 0, 1.1, 0).finished();
  for (const kinematics::Solution& s : machine::inverse_near(arm, X, last).solutions) {
    EXPECT_LT(off(arm, machine::forward(arm, s.joints), X), kExact);
    EXPECT_NEAR(std::abs(std::remainder(s.joints[3] - 1.1, kPi)), 0, kExact);
    if (s.branch != 0) continue;
    EXPECT_EQ(s.joints[3], 1.1);
  }
  // Beside it nothing is free, however near.
  const Pose beside = machine::forward(arm, (JointVector(5) << 0.1, 0.2, 0.3, 0.7, 1e-5).finished());
  for (const kinematics::Solution& s : machine::inverse(arm, beside).solutions) {
    EXPECT_NEAR(std::abs(std::remainder(s.joints[3] - 0.7, kPi)), 0, 1e-9);
    EXPECT_TRUE(kinematics::free_joints(machine::AnyMachine{arm}, beside, s.joints).empty());
  }
}

/// A free joint whose range does not hold 0, a range two turns off, and a head whose tip goes round beside its axis, so
/// that the linear axes reach with some angles alone.
TEST(CartesianInverse, AFreeJointStandsWithinTheLimitsWhereAnyAngleDoes) {
  SerialArm arm = arm_of(kFork);
  arm.dh[3].range = {0.4, 3.5};
  const Pose X = machine::forward(arm, JointVector::Zero(5));
  for (const kinematics::Solution& s : machine::inverse(arm, X).solutions) EXPECT_EQ(s.violations, 0U);
  SerialArm far = arm_of(kFork);
  far.dh[3].range = {2 * kPi, 4 * kPi};
  std::mt19937 random(6);
  for (int k = 0; k < 200; ++k) {
    JointVector q = random_joints(far, random);
    q[3] += 3 * kPi;
    const kinematics::InverseResult found = machine::inverse(far, machine::forward(far, q));
    for (const kinematics::Solution& s : found.solutions) EXPECT_EQ(s.violations & 0xc0U, 0U) << s.joints[3];
  }
  SerialArm offset = arm_of(kFork);
  offset.dh[4].a = 0.1;
  offset.dh[1].range = {-1, 1};
  int within = 0;
  for (double y = -1.147; y < 1.16; y += 0.05) {
    Pose at = machine::forward(offset, JointVector::Zero(5));
    at.p = Vec3(0.2, y, -0.1);
    bool any = false;  // by hand, over a turn
    for (double c = 0; c < 2 * kPi; c += 0.01) {
      const JointVector q =
          machine::inverse_near(offset, at, (JointVector(5) << 0, 0, 0, c, 0).finished()).solutions.front().joints;
      any = any || std::abs(q[1]) <= 1;
    }
    const bool found = machine::inverse(offset, at).reachable() != nullptr;
    EXPECT_EQ(found, any) << y;
    within += found;
  }
  EXPECT_GT(within, 40);
  EXPECT_LT(within, 47);
}

TEST(CartesianInverse, WhereANutatingHeadCannotPointItsToolThereIsNone) {
  const SerialArm arm = arm_of(kNutating);
  // The tool leans by up to 90 deg from the first rotary axis, where both branches are one, and not beyond.
  const Pose at_zero = machine::forward(arm, JointVector::Zero(5));
  Pose X = at_zero;
  X.R = at_zero.R * rotation_abc(kPi, 0, 0);
  const kinematics::InverseResult found = machine::inverse(arm, X);
  EXPECT_TRUE(found.solutions.empty());
  EXPECT_EQ(found.reason, "the rotary axes cannot turn the tool there");
  // At 90 deg itself, half a turn of the second axis from in line.
  SerialArm swivel = arm_of(kFork);
  swivel.dh[3].alpha = kPi / 4;
  swivel.dh[4].alpha = -kPi / 4;
  const Pose across = machine::forward(swivel, (JointVector(5) << 0, 0, 0, 0.3, kPi).finished());
  const kinematics::InverseResult folded = machine::inverse(swivel, across);
  ASSERT_EQ(folded.solutions.size(), 2U);
  for (const kinematics::Solution& s : folded.solutions) {
    EXPECT_TRUE(s.singular);
    EXPECT_NEAR(std::abs(std::remainder(s.joints[4] - kPi, 2 * kPi)), 0, 1e-7);
  }
}

TEST(CartesianInverse, OtherMachinesHaveNone) {
  EXPECT_FALSE(CartesianInverse::of(std::get<SerialArm>(test::load("lola50"))));
  EXPECT_FALSE(CartesianInverse::of(std::get<SerialArm>(test::load("kuka-kr210"))));
  // Linear axes in one plane; a rotary axis among them; rotary axes in line.
  SerialArm flat = arm_of(kFork);
  flat.dh[0].alpha = flat.dh[1].alpha = 0;
  EXPECT_FALSE(CartesianInverse::of(flat));
  SerialArm among = arm_of(kFork);
  std::swap(among.dh[2], among.dh[3]);
  EXPECT_FALSE(CartesianInverse::of(among));
  SerialArm in_line = arm_of(kFork);
  in_line.dh[3].alpha = 0;
  EXPECT_FALSE(CartesianInverse::of(in_line));
}

// --------------------------------------------------------------------------------------------- what a pose leaves open

constexpr const char* kOnARail = R"(
family = "serial"
dh = [ {joint="prismatic", alpha_deg=-90, theta_offset_deg=90}, {a_mm=260, alpha_deg=-90, d_mm=675}, {a_mm=680},
       {a_mm=-35, alpha_deg=90, theta_offset_deg=-90}, {alpha_deg=-90, d_mm=-670}, {alpha_deg=90}, {d_mm=-115, alpha_deg=180} ]
base = { b_deg = 90 }
limits = [ {min_mm=-1000, max_mm=1000}, {min_deg=-185, max_deg=185}, {min_deg=-155, max_deg=35}, {min_deg=-130, max_deg=154},
           {min_deg=-350, max_deg=350}, {min_deg=-130, max_deg=130}, {min_deg=-350, max_deg=350} ]
)";

TEST(FreeJoints, AreTheJointsOfTheKernel) {
  const machine::AnyMachine rail{arm_of(kOnARail)};
  std::mt19937 random(3);
  std::uniform_real_distribution<double> share(0.1, 0.9);
  for (int k = 0; k < 50; ++k) {
    JointVector q(7);
    for (int i = 0; i < 7; ++i) {
      const machine::JointRange range = kinematics::joint_range(rail, i);
      q[i] = range.min + share(random) * (range.max - range.min);
    }
    const Pose X = machine::forward(std::get<SerialArm>(rail), q);
    const std::vector<int> free = kinematics::free_joints(rail, X, q);
    // All joints take part in moving the arm along its rail with the tool in place.
    EXPECT_EQ(free.size(), 7U) << k;
  }
  for (const char* name : {"kuka-kr210", "lola50", "hexapod-strut", "delta-brno", "tricept", "delta-par4"}) {
    const machine::AnyMachine m = test::load(name);
    const Pose X = kinematics::home_pose(m).value_or(Pose{});
    const kinematics::InverseResult there = kinematics::inverse(m, X);
    for (const kinematics::Solution& s : there.solutions) {
      if (s.singular) continue;
      EXPECT_TRUE(kinematics::free_joints(m, X, s.joints).empty()) << name;
    }
  }
}

TEST(FreeJoints, AStraightWristLeavesItsTwoAxesFreeTogether) {
  const machine::AnyMachine arm = test::load("kuka-kr210");
  const JointVector q = (JointVector(6) << 0.2, -1.2, 1.4, 0.3, 0, 0.5).finished();
  const Pose X = machine::forward(std::get<SerialArm>(arm), q);
  EXPECT_EQ(kinematics::free_joints(arm, X, q), (std::vector<int>{3, 5}));
  EXPECT_EQ(kinematics::in_words_free({3, 5}), "joints 4 and 6 can move together while the tool stays");
  EXPECT_EQ(kinematics::in_words_free({3}), "joint 4 can move while the tool stays");
  EXPECT_EQ(kinematics::in_words_free({}), "");
}

TEST(FreeJoints, WhereOneIsFreeASolutionWithinTheLimitsIsFoundToTheEndsOfTheRail) {
  const SerialArm arm = arm_of(kOnARail);
  std::mt19937 random(4);
  std::uniform_real_distribution<double> share(0, 1);
  int found = 0, tried = 0;
  for (int k = 0; k < 300; ++k) {
    JointVector q(7);
    for (int i = 0; i < 7; ++i) {
      const machine::JointRange range = machine::joint_range(arm, i);
      // Near either end of the rail, and anywhere else within the other limits.
      const double part = i == 0 ? (k % 2 == 0 ? 0.02 : 0.98) : share(random);
      q[i] = range.min + part * (range.max - range.min);
    }
    ++tried;
    found += machine::inverse(arm, machine::forward(arm, q)).reachable() != nullptr;
  }
  EXPECT_EQ(found, tried);
}

}  // namespace
}  // namespace polypod
