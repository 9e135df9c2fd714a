// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/statics/compliance.hpp"

#include <gmock/gmock.h>

#include <Eigen/Eigenvalues>

#include "polypod/core/units.hpp"
#include "polypod/families/delta/kinematics.hpp"
#include "polypod/families/serial/kinematics.hpp"
#include "polypod/statics/under_load.hpp"

namespace polypod::statics {
namespace {

const machine::AnyMachine& lola() {
  static const machine::AnyMachine m = *machine::load("lola50");
  return m;
}

Pose at(double x_mm, double y_mm, double z_mm) {
  return {Mat3::Identity(), Vec3(units::from_mm(x_mm), units::from_mm(y_mm), units::from_mm(z_mm))};
}

// SLAV (4.43): printed to four digits, um/N.
TEST(Compliance, Equation4_43) {
  const Compliance c = compliance_at(lola(), at(0, -1300, 0));
  ASSERT_TRUE(c.reachable) << c.reason;
  const Mat3 um_per_N = c.linear() * 1e6;
  Mat3 printed;
  printed << 1.924, 0, 0, 0, 2.570, -1.216, 0, -1.216, 3.438;
  constexpr double kPrinted = 6e-4;  // half a printed digit, and the lengths' third digit
  EXPECT_LT((um_per_N - printed).cwiseAbs().maxCoeff(), kPrinted) << um_per_N;
  const Vec3 moved = c.displacement(Vec3(0, 100, 0));
  EXPECT_NEAR(units::to_mm(moved.y()), 0.257, 5e-4);
  EXPECT_NEAR(units::to_mm(moved.z()), -0.122, 5e-4);
}

// SLAV (4.44): the 5 x 5 matrix, to its three digits.
TEST(Compliance, Equation4_44) {
  const Mat6 C = compliance_at(lola(), at(0, -1300, 0)).C;
  Eigen::Matrix<double, 5, 5> printed;
  printed << 1.92e-6, 0, 0, 0, -9.78e-7, 0, 2.57e-6, -1.22e-6, 5.16e-6, 0, 0, -1.22e-6, 3.44e-6, -2.97e-6, 0, 0,
      5.16e-6, -2.96e-6, 1.24e-5, 0, -9.78e-7, 0, 0, 0, 2.40e-6;
  // The printed matrix is not symmetric in the last digit of its entries (3, 4) and (4, 3): one unit there.
  for (int i = 0; i < 5; ++i)
    for (int j = 0; j < 5; ++j) {
      const double digit =
          printed(i, j) == 0 ? 1e-10 : std::pow(10, std::floor(std::log10(std::abs(printed(i, j)))) - 2);
      EXPECT_NEAR(C(i, j), printed(i, j), 1.01 * digit) << i << "," << j;
    }
}

TEST(Compliance, IsSymmetricAndSharesAddUp) {
  for (int k = 0; k < 20; ++k) {
    const Compliance c = compliance_at(lola(), at(-500 + 50 * k, -1550 + 25 * k, -350 + 20 * k));
    ASSERT_TRUE(c.reachable) << c.reason;
    Mat6 sum = Mat6::Zero();
    for (const Mat6& share : c.by_joint) sum += share;
    EXPECT_LT((c.C - c.C.transpose()).cwiseAbs().maxCoeff(), 1e-18);
    EXPECT_LT((c.C - sum).cwiseAbs().maxCoeff(), 1e-18);
    EXPECT_GE(Eigen::SelfAdjointEigenSolver<Mat6>(c.C).eigenvalues()[0], -1e-18);
  }
}

TEST(Compliance, ProbeAgreesWithTheFullMatrix) {
  Probe probe(lola(), Mat3::Identity());
  for (int k = 0; k < 20; ++k) {
    const Pose X = at(-500 + 50 * k, -1550 + 25 * k, -350 + 20 * k);
    Mat3 C;
    ASSERT_TRUE(probe.at(X.p, C));
    EXPECT_LT((C - compliance_at(lola(), X).linear()).cwiseAbs().maxCoeff(), 1e-18);
  }
  Mat3 C;
  EXPECT_FALSE(probe.at(Vec3(0, -5, 0), C));
  EXPECT_THAT(probe.why(), ::testing::HasSubstr("out of reach"));
}

Eigen::MatrixXd J_of(const machine::SerialArm& arm, const machine::JointVector& q) {
  return machine::jacobian(arm, machine::forward(arm, q), q).topRows<3>();
}
machine::JointVector compliances(const machine::SerialArm& arm) {
  machine::JointVector out(arm.free_joints());
  for (Eigen::Index i = 0; i < out.size(); ++i) out[i] = arm.dh[static_cast<std::size_t>(i)].compliance;
  return out;
}

// SLAV 4.5: where the compliances grow and fall in the plane z = 0, and which joints give the most.
/// The exact balance, in which the joints turn and their levers with them, beside the linear one: what Chen and Kao's
/// K_C stands for is at most 0.12 % of the deflection at 500 N (docs/limits.md).
TEST(Compliance, WhatTheLoadDoesToTheLeversIsSmall) {
  const auto& arm = std::get<machine::SerialArm>(lola());
  double most = 0;
  for (const Vec3& p : {Vec3(0, -1300, 0), Vec3(-400, -1200, 100), Vec3(300, -1500, -100)}) {
    const Compliance c = compliance_at(lola(), at(p.x(), p.y(), p.z()));
    ASSERT_TRUE(c.reachable) << c.reason;
    for (const Vec3& direction : {Vec3(1, 0, 0), Vec3(0, 1, 0), Vec3(0, 0, 1), Vec3(1, 1, -1).normalized().eval()}) {
      const Vec3 F = 500 * direction;
      machine::JointVector q = c.joints;
      Pose X = machine::forward(arm, q);
      for (int round = 0; round < 10; ++round) {
        const machine::JacobianMatrix J = machine::jacobian(arm, X, q);
        for (Eigen::Index i = 0; i < q.size(); ++i)
          q[i] = c.joints[i] + arm.dh[static_cast<std::size_t>(i)].compliance * J.col(i).head<3>().dot(F);
        X = machine::forward(arm, q);
      }
      const Vec3 linear = c.displacement(F), exact = X.p - machine::forward(arm, c.joints).p;
      EXPECT_GT(linear.norm(), 0.5e-3);
      const auto loaded = under_load(lola(), c.joints, F);
      ASSERT_TRUE(loaded);
      EXPECT_LT((loaded->linear - linear).norm(), 1e-12);
      EXPECT_LT((loaded->exact - exact).norm(), 1e-9);
      // The first order of the difference is the term K_C = dJ^T/dq F, by differences of the Jacobian here.
      const machine::JointVector turned = (J_of(arm, c.joints).transpose() * F).cwiseProduct(compliances(arm));
      Eigen::MatrixXd K_C(q.size(), q.size());
      constexpr double kStep = 1e-6;
      for (Eigen::Index j = 0; j < q.size(); ++j) {
        machine::JointVector more = c.joints, less = c.joints;
        more[j] += kStep;
        less[j] -= kStep;
        K_C.col(j) = (J_of(arm, more) - J_of(arm, less)).transpose() * F / (2 * kStep);
      }
      // x = J C_q (1 - K_C C_q)^-1 J^T F, and half of what the levers move while the joints turn.
      const Eigen::MatrixXd C_q = compliances(arm).asDiagonal();
      const Vec3 by_term = J_of(arm, c.joints) * (C_q * (K_C * turned));
      Vec3 by_levers = Vec3::Zero();
      for (Eigen::Index j = 0; j < q.size(); ++j) {
        machine::JointVector more = c.joints;
        more[j] += kStep;
        by_levers += 0.5 * turned[j] * (J_of(arm, more) - J_of(arm, c.joints)) / kStep * turned;
      }
      const Vec3 change = exact - linear;
      EXPECT_LT((by_term + by_levers - change).norm(), 0.02 * change.norm());
      most = std::max(most, (exact - linear).norm() / linear.norm());
    }
  }
  EXPECT_LT(most, 1.2e-3) << most;
  EXPECT_GT(most, 1e-4) << most;
}

TEST(Compliance, MapFollowsTheSourcesDescription) {
  const auto c = [](double x, double y) { return compliance_at(lola(), at(x, y, 0)); };
  for (double x : {-600.0, 0.0, 600.0}) {
    EXPECT_GT(c(x, -1600).linear()(0, 0), c(x, -1000).linear()(0, 0));  // C_xx falls towards +y
    EXPECT_GT(c(x, -1600).linear()(2, 2), c(x, -1000).linear()(2, 2));  // C_zz too
    EXPECT_LT(c(x, -1600).linear()(1, 1), c(x, -1000).linear()(1, 1));  // C_yy grows
  }
  for (double side : {-600.0, 600.0}) {
    EXPECT_GT(c(side, -1300).linear()(0, 0), c(0, -1300).linear()(0, 0));
    EXPECT_LT(c(side, -1300).linear()(1, 1), c(0, -1300).linear()(1, 1));
  }
  const Compliance mid = c(0, -1300);
  EXPECT_LT(mid.by_joint[1](1, 1) + mid.by_joint[3](1, 1), 0.01 * mid.C(1, 1));  // joints 2 and 4 do not bend y
}

TEST(Compliance, LockedJointWithABrakeThatGivesWayCounts) {
  const auto rigid = *machine::load("lola50");
  auto table = machine::from_text(R"(
family = "serial"
task = "axis"
dh = [ {alpha_deg=90, theta_offset_deg=-90}, {a_mm=850, theta_offset_deg=90}, {alpha_deg=90},
       {alpha_deg=-90, d_mm=1100, sign=-1}, {a_mm=407, theta_offset_deg=180}, {} ]
locked = { 6 = 0 }
tool = { b_deg = 90, c_deg = 180 }
compliance_rad_per_Nm = [9.03e-7, 11.17e-7, 14.74e-7, 27.65e-7, 97.58e-7, 50e-7]
)",
                                  "six.toml");
  ASSERT_TRUE(table) << to_string(table.error());
  const Compliance with = compliance_at(*table, at(100, -1300, 0)), without = compliance_at(rigid, at(100, -1300, 0));
  ASSERT_TRUE(with.reachable && without.reachable);
  ASSERT_EQ(with.by_joint.size(), 6u);
  EXPECT_LT((with.C - with.by_joint[5] - without.C).cwiseAbs().maxCoeff(), 1e-15);
  EXPECT_GT(with.by_joint[5].norm(), 0);
}

TEST(PathError, SharesAddUpAlongTheWay) {
  const auto path = path_error(lola(), Vec3(-0.6, -1.3, 0), Vec3(0.6, -1.3, 0), 13, Mat3::Identity(), Vec3(0, 100, 0));
  ASSERT_EQ(path.size(), 13u);
  for (const PathError& e : path) {
    ASSERT_TRUE(e.reachable);
    Vec3 sum = Vec3::Zero();
    for (const Vec3& share : e.by_joint) sum += share;
    EXPECT_LT((sum - e.total).norm(), 1e-15);
  }
  EXPECT_NEAR(units::to_mm(path[6].total.y()), 0.257, 5e-4);
}

/// What the chains of a delta carry when the tip has moved by `moved` from X: springs in series, the drive's about its
/// axis and the parallelogram's along it, from distances alone.
template <class M>
Vec3 resistance(const M& m, const Vec3& X, const Vec3& moved, const machine::JointVector& q) {
  constexpr double kStep = 1e-6;
  Vec3 out = Vec3::Zero();
  for (int i = 0; i < m.arms; ++i) {
    const auto distance = [&](const Vec3& at, double drive) {
      return (at + m.platform_joint[i] - m.tool - machine::driven_end(m, i, drive)).norm();
    };
    const double stretched = distance(X + moved, q[i]) - distance(X, q[i]);
    const double by_drive = (distance(X, q[i] + kStep) - distance(X, q[i] - kStep)) / (2 * kStep);
    const double gives = by_drive * by_drive * m.drive_compliance[std::size_t(i)] + m.rod_compliance[std::size_t(i)];
    out += stretched / gives * (X + m.platform_joint[i] - m.tool - machine::driven_end(m, i, q[i])).normalized();
  }
  return out;
}

// Three arms, and four that share the load: the displacement C F is where the chains' springs carry F. Moves of some
// nanometres, so that what is not linear stays below 1e-5.
TEST(Compliance, DeltasStandWhereTheirSpringsCarryTheForce) {
  for (const char* arms : {"3", "4"}) {
    for (const char* name : {"delta-picker", "delta-linear"}) {
      SCOPED_TRACE(std::string(name) + " with arms: " + arms);
      const bool rotary = std::string(name) == "delta-picker";
      const auto loaded = machine::load(name, {{rotary ? "arm.count" : "rail.count", arms}, {"rod.diameter_mm", "0"}});
      ASSERT_TRUE(loaded) << to_string(loaded.error());
      std::vector<double> c = column_compliances(*loaded);
      ASSERT_EQ(c.size(), 2 * std::size_t(std::stoi(arms)));
      for (std::size_t i = 0; i < c.size(); ++i) {
        const double size = 1 + 0.3 * double(i % 3);
        c[i] = i < c.size() / 2 && rotary ? 1e-8 * size : 3e-10 * size;
      }
      const machine::AnyMachine m = *with_compliances(*loaded, c);
      const Pose X{Mat3::Identity(), rotary ? Vec3(0.1, -0.15, 0.8) : Vec3(0.03, -0.02, 0.6)};
      const Compliance at = compliance_at(m, X);
      ASSERT_TRUE(at.reachable) << at.reason;
      Mat6 sum = Mat6::Zero();
      for (const Mat6& share : at.by_joint) sum += share;
      EXPECT_LT((sum - at.C).norm(), 1e-12 * at.C.norm());
      for (const Vec3& force : {Vec3(10, 0, 0), Vec3(0, 10, 0), Vec3(3, -4, 9)}) {
        const Vec3 moved = at.displacement(force);
        const Vec3 carried = rotary ? resistance(std::get<machine::RotaryDelta>(m), X.p, moved, at.joints)
                                    : resistance(std::get<machine::LinearDelta>(m), X.p, moved, at.joints);
        EXPECT_LT((carried - force).norm(), 1e-5 * force.norm());
      }
    }
  }
}

}  // namespace
}  // namespace polypod::statics
