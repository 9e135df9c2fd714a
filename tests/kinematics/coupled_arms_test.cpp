// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Arms whose joints are coupled against the same arms without coupling, whose joints follow by hand.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "joints.hpp"
#include "machines.hpp"
#include "polypod/core/units.hpp"
#include "polypod/families/serial/kinematics.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/closure.hpp"
#include "polypod/kinematics/posture.hpp"

namespace polypod {
namespace {

using machine::JointVector;
using machine::SerialArm;

/// An arm, which of its joints (from 0) which other one turns too, and by how much.
struct Coupled {
  const char* name;
  SerialArm arm;
  int joint, by;
  double ratio;
};

SerialArm with_coupling(SerialArm arm, std::size_t row, int back, double ratio) {
  arm.dh[row].coupled_back = back;
  arm.dh[row].coupling = ratio;
  return arm;
}

std::vector<Coupled> arms() {
  const auto load = [](const char* name) { return std::get<SerialArm>(test::load(name)); };
  SerialArm rail = load("abb-irb6700");
  machine::DhRow first;
  first.kind = machine::JointKind::prismatic;
  first.range = {-1, 1};
  rail.dh.insert(rail.dh.begin(), first);
  return {{"spherical wrist, joint 3 counts from the base", with_coupling(load("abb-irb6700"), 2, 1, -1), 2, 1, -1},
          {"modified table", with_coupling(load("kuka-kr210"), 2, 1, 1), 2, 1, 1},
          {"three parallel axes, a wrist that is geared", with_coupling(load("ur10e"), 5, 1, 0.25), 5, 4, 0.25},
          {"five axes", with_coupling(load("lola50"), 2, 1, -1), 2, 1, -1},
          {"on a rail", with_coupling(rail, 3, 1, -1), 3, 2, -1}};
}

/// The arm without coupling, whose joints may turn as far as those of the coupled one take them.
SerialArm without(SerialArm arm) {
  for (machine::DhRow& row : arm.dh) {
    row.coupled_back = 0;
    if (row.kind == machine::JointKind::revolute) row.range = {-20, 20};
  }
  return arm;
}

/// The joints of the arm without coupling that stands alike.
JointVector uncoupled(const Coupled& c, JointVector q) {
  q[c.joint] += c.arm.dh[static_cast<std::size_t>(c.joint)].sign * c.ratio * q[c.by];
  return q;
}

TEST(CoupledArms, StandAsTheirJointsSay) {
  std::mt19937 random(2);
  for (const Coupled& c : arms()) {
    SCOPED_TRACE(c.name);
    for (int trial = 0; trial < 50; ++trial) {
      const JointVector q = test::within_limits(c.arm, random);
      const Pose X = machine::forward(c.arm, q);
      EXPECT_LT(test::difference(X, machine::forward(without(c.arm), uncoupled(c, q))), 1e-12);
      // The chain on any number type, and the Jacobian by central differences.
      const std::vector<double> p = machine::parameter_values(c.arm);
      const std::span<const double> joints(q.data(), static_cast<std::size_t>(q.size()));
      EXPECT_LT(test::difference(X, machine::chain(c.arm, joints, std::span<const double>(p))), 1e-12);
      const machine::JacobianMatrix J = machine::jacobian(c.arm, X, q);
      for (int i = 0; i < q.size(); ++i) {
        constexpr double kStep = 1e-6;
        JointVector up = q, down = q;
        up[i] += kStep;
        down[i] -= kStep;
        const Pose high = machine::forward(c.arm, up), low = machine::forward(c.arm, down);
        Eigen::Matrix<double, 6, 1> d;
        d << (high.p - low.p) / (2 * kStep), rotation_vector(high.R * low.R.transpose()) / (2 * kStep);
        EXPECT_LT((d - J.col(i)).cwiseAbs().maxCoeff(), 1e-7) << "joint " << i + 1;
      }
    }
  }
}

TEST(CoupledArms, EveryBranchIsFoundWithinTheLimitsOfTheirOwnJoints) {
  std::mt19937 random(4);
  for (const Coupled& c : arms()) {
    SCOPED_TRACE(c.name);
    const machine::AnyMachine m{c.arm};
    for (int trial = 0; trial < 200; ++trial) {
      const JointVector q = test::within_limits(c.arm, random);
      const Pose X = machine::forward(c.arm, q);
      const auto inverse = kinematics::inverse(m, X);
      ASSERT_NE(inverse.reachable(), nullptr) << q.transpose();
      for (const kinematics::Solution& s : inverse.solutions) {
        const Pose there = machine::forward(c.arm, s.joints);
        EXPECT_LT((there.p - X.p).norm(), 1e-9);
        EXPECT_LT((there.R.col(2) - X.R.col(2)).norm(), 1e-9);
        kinematics::LimitBits broken = 0;
        for (int i = 0; i < c.arm.free_joints(); ++i) {
          const machine::JointRange r = joint_range(c.arm, i);
          if (s.joints[i] < r.min - 1e-9) broken |= kinematics::LimitBits{1} << (2 * i);
          if (s.joints[i] > r.max + 1e-9) broken |= kinematics::LimitBits{2} << (2 * i);
        }
        EXPECT_EQ(s.violations, broken);
      }
      // Seen from these joints, they themselves; in a posture with the name that the arm without coupling has there.
      const auto near = kinematics::inverse_near(m, X, q);
      ASSERT_NE(near.reachable(), nullptr);
      EXPECT_LT((near.reachable()->joints - q).cwiseAbs().maxCoeff(), 1e-6);
      if (c.arm.free_joints() > 6) continue;  // the posture of a rail is a choice
      EXPECT_EQ(kinematics::posture_of(m, q),
                kinematics::posture_of(machine::AnyMachine(without(c.arm)), uncoupled(c, q)));
    }
  }
}

/// The drive of joint 2 of a parallelogram lets the forearm keep its direction: the wrist centre moves in a circle.
TEST(CoupledArms, AParallelogramKeepsTheForearmsDirection) {
  const SerialArm arm = with_coupling(std::get<SerialArm>(test::load("abb-irb6700")), 2, 1, -1);
  JointVector q(6);
  q << 0.2, 0.1, 0.3, 0.4, 0.5, 0.6;
  const Mat3 R = machine::forward(arm, q).R;
  q[1] += 0.4;
  EXPECT_LT((machine::forward(arm, q).R - R).norm(), 1e-12);
}

TEST(CoupledArms, AreWrittenAndReadBack) {
  for (const Coupled& c : arms()) {
    const SerialArm again = test::arm_of(machine::to_toml(c.arm));
    std::mt19937 random(9);
    const JointVector q = test::within_limits(c.arm, random);
    EXPECT_LT(test::difference(machine::forward(again, q), machine::forward(c.arm, q)), 1e-10);
    EXPECT_TRUE(again.is_coupled());
  }
}

TEST(CoupledArms, RowsThatDoNotBelongTogetherAreRefused) {
  const auto id_of = [](const std::string& third) {
    const auto m = machine::from_text(
        "family = \"serial\"\ndh = [ { a_mm = 100, joint = \"prismatic\" }, { a_mm = 100 }, "
        "{ a_mm = 100" +
            third + " } ]\n",
        "t.toml");
    return m ? std::string() : m.error().id;
  };
  EXPECT_EQ(id_of(", coupled_to = 2, coupling = -1"), "");
  for (const char* bad : {", coupled_to = 2", ", coupling = 1", ", coupled_to = 3, coupling = 1",
                          ", coupled_to = 0, coupling = 1", ", coupled_to = 1.5, coupling = 1",
                          ", coupled_to = 1, coupling = 1", ", coupled_to = 2, coupling = 1, joint = \"prismatic\""})
    EXPECT_EQ(id_of(bad), "MA148") << bad;
}

}  // namespace
}  // namespace polypod
