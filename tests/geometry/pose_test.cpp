// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/geometry/pose.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <numbers>
#include <random>

#include "polypod/core/interval.hpp"

namespace polypod {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kRounding = 1e-14;  // a few dozen roundings of numbers of size 1
constexpr double kAngles = 1e-13;    // angles away from gimbal lock: roundings over cos(1.5) = 0.07
constexpr int kSamples = 20'000;
constexpr unsigned kSeed = 5150;

class Geometry : public ::testing::Test {
 protected:
  double between(double lo, double hi) { return lo + (hi - lo) * unit_(engine_); }
  Vec3 direction() {
    for (;;) {
      const Vec3 v(between(-1, 1), between(-1, 1), between(-1, 1));
      if (v.norm() > 0.1 && v.norm() < 1) return v.normalized();
    }
  }
  Pose pose() { return {rotation_of(between(0, kPi) * direction()), 2 * Vec3(between(-1, 1), between(-1, 1), 1)}; }

 private:
  std::mt19937_64 engine_{kSeed};
  std::uniform_real_distribution<double> unit_{0, 1};
};

TEST_F(Geometry, AnglesGiveTheRotationBack) {
  for (int k = 0; k < kSamples; ++k) {
    const double a = between(-kPi, kPi), b = between(-kPi, kPi), c = between(-kPi, kPi);
    const Mat3 R = rotation_abc(a, b, c);
    const Vec3 angles = angles_abc(R);
    ASSERT_LE(std::abs(angles.y()), kPi / 2);
    ASSERT_LT((rotation_abc(angles.x(), angles.y(), angles.z()) - R).norm(), kRounding) << a << ' ' << b << ' ' << c;
    if (std::abs(b) < 1.5) {  // away from gimbal lock the angles themselves come back
      ASSERT_LT((angles - Vec3(a, b, c)).norm(), kAngles) << "seed " << kSeed;
    }
  }
}

TEST_F(Geometry, AnglesGiveTheRotationBackNearGimbalLock) {
  for (double off : {0.0, 1e-16, 1e-15, 1e-14, 1e-13, 1e-12, 1e-11, 1e-10, 1e-8, 1e-6, 1e-3}) {
    for (double side : {-1.0, 1.0}) {
      for (int k = 0; k < 200; ++k) {
        const Mat3 R = rotation_abc(between(-kPi, kPi), side * (kPi / 2 - off), between(-kPi, kPi));
        const Vec3 angles = angles_abc(R);
        // Where cos B is below the threshold of 1e-14 what is left of it is dropped.
        ASSERT_LT((rotation_abc(angles.x(), angles.y(), angles.z()) - R).norm(), 3e-14) << "off " << off;
      }
    }
  }
}

TEST_F(Geometry, TheSourcesOrderOfTurns) {
  // R_z(90) R_y(0) R_x(90): x -> y, y -> z, z -> x.
  const Mat3 R = rotation_abc(kPi / 2, 0, kPi / 2);
  EXPECT_LT((R * Vec3::UnitX() - Vec3::UnitY()).norm(), kRounding);
  EXPECT_LT((R * Vec3::UnitY() - Vec3::UnitZ()).norm(), kRounding);
  EXPECT_LT((R * Vec3::UnitZ() - Vec3::UnitX()).norm(), kRounding);
}

TEST_F(Geometry, ToolAxisIsTheThirdColumn) {
  for (int k = 0; k < kSamples; ++k) {
    const double a = between(-kPi / 2, kPi / 2), b = between(-kPi, kPi);
    const Vec3 axis = tool_axis_ab(a, b);
    ASSERT_LT((axis - (rotation_y(b) * rotation_x(a)).col(2)).norm(), kRounding);
    const Eigen::Vector2d angles = angles_ab(axis);
    ASSERT_LT((tool_axis_ab(angles[0], angles[1]) - axis).norm(), kRounding);
    if (std::abs(a) < 1.5) {
      ASSERT_LT((angles - Eigen::Vector2d(a, b)).norm(), kAngles) << "seed " << kSeed;
    }
  }
}

TEST_F(Geometry, ToolAxisAlongYHasAnyB) {
  EXPECT_EQ(angles_ab({0, 1, 0}), Eigen::Vector2d(-kPi / 2, 0));
  EXPECT_EQ(angles_ab({0, -1, 0}), Eigen::Vector2d(kPi / 2, 0));
}

TEST_F(Geometry, RotationVectorsGoThereAndBack) {
  for (int k = 0; k < kSamples; ++k) {
    const double angle = between(0, kPi - 1e-6);
    const Vec3 w = angle * direction();
    ASSERT_LT((rotation_vector(rotation_of(w)) - w).norm(), 1e-9) << "angle " << angle;
  }
  for (double angle : {0.0, 1e-300, 1e-12, 1e-9, 1e-6, 1e-3}) {
    for (int k = 0; k < 100; ++k) {
      const Vec3 w = angle * direction();
      ASSERT_LT((rotation_vector(rotation_of(w)) - w).norm(), kRounding) << "angle " << angle;
    }
  }
}

TEST_F(Geometry, HalfTurnsHaveAnAngleOfPi) {
  for (int k = 0; k < kSamples; ++k) {
    const Vec3 axis = direction();
    const Mat3 R = 2 * axis * axis.transpose() - Mat3::Identity();
    const Vec3 w = rotation_vector(R);
    ASSERT_NEAR(w.norm(), kPi, 1e-12);
    ASSERT_NEAR(std::abs(w.dot(axis)), kPi, 1e-12) << "either sign of the axis is right";
  }
}

TEST_F(Geometry, ARotationVectorTurnsRoundItsAxisByItsLength) {
  for (int k = 0; k < kSamples; ++k) {
    const Vec3 axis = direction(), v = direction();
    const double angle = between(0, kPi);
    // Rodrigues' formula as the second way.
    const Vec3 turned =
        v * std::cos(angle) + axis.cross(v) * std::sin(angle) + axis * axis.dot(v) * (1 - std::cos(angle));
    ASSERT_LT((rotation_of(angle * axis) * v - turned).norm(), kRounding);
  }
}

TEST_F(Geometry, PosesFormAGroup) {
  constexpr double kPositions = 1e-13;  // roundings of numbers up to 10
  for (int k = 0; k < kSamples; ++k) {
    const Pose X_AB = pose(), X_BC = pose(), X_CD = pose();
    const Vec3 p_D(between(-1, 1), between(-1, 1), between(-1, 1));
    const Pose left = (X_AB * X_BC) * X_CD, right = X_AB * (X_BC * X_CD);
    ASSERT_LT((left.p - right.p).norm() + (left.R - right.R).norm(), kPositions);
    ASSERT_LT((left * p_D - X_AB * (X_BC * (X_CD * p_D))).norm(), kPositions);
    const Pose unit = X_AB * X_AB.inverse();
    ASSERT_LT(unit.p.norm() + (unit.R - Mat3::Identity()).norm(), kPositions);
    ASSERT_NEAR(left.R.determinant(), 1, kPositions);
  }
}

TEST_F(Geometry, SkewIsTheCrossProduct) {
  for (int k = 0; k < 1000; ++k) {
    const Vec3 w = direction(), v = direction();
    ASSERT_LT((skew(w) * v - w.cross(v)).norm(), kRounding);
  }
}

TEST_F(Geometry, PosesOfIntervalsHoldThePosesInThem) {
  for (int k = 0; k < 1000; ++k) {
    const Pose a = pose(), b = pose();
    const Pose c = a * b;
    const PoseT<Interval> box = a.cast<Interval>() * b.cast<Interval>();
    for (int i = 0; i < 3; ++i) {
      ASSERT_TRUE(box.p[i].contains(c.p[i]));
      for (int j = 0; j < 3; ++j) ASSERT_TRUE(box.R(i, j).contains(c.R(i, j)));
    }
  }
}

}  // namespace
}  // namespace polypod
