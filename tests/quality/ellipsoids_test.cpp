// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Ellipsoids of velocity and force: closed forms, and the unit ball itself.
#include "polypod/quality/ellipsoids.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "polypod/families/hexapod/strut_kinematics.hpp"

namespace polypod::quality {
namespace {

using kinematics::JacobianMatrix;

constexpr double kRounding = 1e-10;

/// Two links of lengths a and b in the plane of x and y, the first along x, the second turned by `bend`.
JacobianMatrix planar_arm(double a, double b, double bend) {
  JacobianMatrix J = JacobianMatrix::Zero(6, 2);
  J.col(0) << -b * std::sin(bend), a + b * std::cos(bend), 0, 0, 0, 1;
  J.col(1) << -b * std::sin(bend), b * std::cos(bend), 0, 0, 0, 1;
  return J;
}

TEST(Ellipsoids, OfATwoLinkArm) {
  // The squares of the half axes have the sum of all squares and the product (a b sin)^2.
  const double a = 0.4, b = 0.3, bend = 1.1;
  const auto e = ellipsoids(planar_arm(a, b, bend));
  ASSERT_TRUE(e);
  const double sum = a * a + 2 * a * b * std::cos(bend) + 2 * b * b, product = a * b * std::sin(bend);
  const double root = std::sqrt(sum * sum - 4 * product * product);
  EXPECT_NEAR(e->velocity.half_axes[0], std::sqrt((sum + root) / 2), kRounding);
  EXPECT_NEAR(e->velocity.half_axes[1], std::sqrt((sum - root) / 2), kRounding);
  EXPECT_EQ(e->velocity.half_axes[2], 0);
  EXPECT_NEAR(e->velocity.directions.col(2).z(), 1, kRounding);
  EXPECT_TRUE(std::isinf(e->force.half_axes[0]));  // the frame bears what presses along z
  EXPECT_NEAR(e->force.directions.col(0).z(), 1, kRounding);
  EXPECT_NEAR(e->rotation.half_axes[0], std::numbers::sqrt2, kRounding);
  EXPECT_NEAR(e->moment.half_axes[2], 1 / std::numbers::sqrt2, kRounding);
}

TEST(Ellipsoids, OfASymmetricHexapod) {
  // Upright at home the six struts are alike but for their azimuths: each has the same part u along z and the same
  // arm d about z. So along z and about z the six rows of the inverse Jacobian give 6 u^2 and 6 d^2.
  const auto machine = *machine::load("hexapod-strut");
  const auto& hexapod = std::get<machine::StrutHexapod>(machine);
  const Pose X{Mat3::Identity(), {0, 0, 0.075}};
  kinematics::JointVector q(machine::kLegs);
  machine::lengths(hexapod, X, q.data());
  const Vec3 tip = X.p, foot = hexapod.base_joint[0],
             head = tip - Vec3(0, 0, hexapod.tool_length) + hexapod.platform_joint[0];
  const Vec3 along = (head - foot).normalized();
  const double arm = (head - tip).cross(along).z();
  const auto e = ellipsoids(kinematics::jacobian(machine, X, q));
  ASSERT_TRUE(e);
  EXPECT_NEAR(e->velocity.half_axes[2], 1 / (std::sqrt(6) * along.z()), kRounding);
  EXPECT_NEAR(std::abs(e->velocity.directions.col(2).z()), 1, kRounding);
  EXPECT_NEAR(e->rotation.half_axes[0], 1 / (std::sqrt(6) * std::abs(arm)), kRounding / std::abs(arm));
  EXPECT_NEAR(std::abs(e->rotation.directions.col(0).z()), 1, kRounding);
  EXPECT_NEAR(e->velocity.half_axes[0], e->velocity.half_axes[1], kRounding);
}

TEST(Ellipsoids, HoldTheImageOfTheUnitBall) {
  std::mt19937_64 random(7);
  std::normal_distribution<double> normal;
  JacobianMatrix J(6, 6);
  for (double& x : J.reshaped()) x = normal(random);
  const auto e = ellipsoids(J);
  ASSERT_TRUE(e);
  const auto size_in = [](const Ellipsoid& ellipsoid, const Vec3& v) {
    return (ellipsoid.directions.transpose() * v).cwiseQuotient(ellipsoid.half_axes).norm();
  };
  double most = 0;
  for (int i = 0; i < 20'000; ++i) {
    Vec6 u;
    for (double& x : u) x = normal(random);
    u.normalize();
    most = std::max(most, size_in(e->velocity, J.topRows<3>() * u));
    ASSERT_LE(size_in(e->velocity, J.topRows<3>() * u), 1 + kRounding);
    ASSERT_LE(size_in(e->rotation, J.bottomRows<3>() * u), 1 + kRounding);
  }
  EXPECT_GT(most, 0.99);
  for (int k = 0; k < 3; ++k) {
    // The strongest force along an axis takes joint forces of size 1.
    EXPECT_NEAR((J.topRows<3>().transpose() * (e->force.half_axes[k] * e->force.directions.col(k))).norm(), 1,
                kRounding);
    EXPECT_NEAR((J.bottomRows<3>().transpose() * (e->moment.half_axes[k] * e->moment.directions.col(k))).norm(), 1,
                kRounding);
  }
}

TEST(Ellipsoids, NoneWhereTheJacobianIsInfinite) {
  JacobianMatrix J = JacobianMatrix::Zero(6, 6);
  J(0, 0) = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(ellipsoids(J));
}

TEST(Ellipsoids, NoneWhereTheDrivesHoldNothing) {
  // Between equal platforms that stand parallel the struts are parallel: the tool swings while they stand.
  const auto parallel = *machine::from_text(R"(
family = "strut-hexapod"
base = { joints_mm = [[50,0,0],[25,43,0],[-25,43,0],[-50,0,0],[-25,-43,0],[25,-43,0]] }
platform = { joints_mm = [[50,0,0],[25,43,0],[-25,43,0],[-50,0,0],[-25,-43,0],[25,-43,0]] }
leg = { length_min_mm = 50, length_max_mm = 90 }
)",
                                            "parallel.toml", {});
  const auto at = [](const kinematics::AnyMachine& machine) {
    const Pose X{Mat3::Identity(), {0.001, 0.002, 0.07}};
    kinematics::JointVector q(machine::kLegs);
    machine::lengths(std::get<machine::StrutHexapod>(machine), X, q.data());
    return ellipsoids(machine, X, q).has_value();
  };
  EXPECT_FALSE(at(parallel));
  EXPECT_TRUE(at(*machine::load("hexapod-strut")));
}

}  // namespace
}  // namespace polypod::quality
