// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Deltas against geometry written out here, Newton, differences and the equations of the source.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "kinematics/invariants.hpp"
#include "polypod/core/units.hpp"
#include "polypod/families/delta/kinematics.hpp"
#include "polypod/geometry/trilateration.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod {
namespace {

using kinematics::JointVector;
using machine::LinearDelta;
using machine::RotaryDelta;

template <class M>
M load_as(const std::string& name, const std::vector<machine::Override>& sets = {}) {
  const auto m = machine::load(name, sets);
  if (!m) throw std::runtime_error(to_string(m.error()));
  return std::get<M>(*m);
}

/// Arms and directions that are all different.
constexpr const char* kGeneral = R"(
family = "rotary-delta"
arms = [
  { base_mm = [0, 250, 5], direction_deg = 88, arm_mm = 180, rod_mm = 550, platform_mm = [2, 80, -3], zero_deg = 2 },
  { base_mm = [-220, -120, 0], direction_deg = 212, arm_mm = 175, rod_mm = 560, platform_mm = [-70, -40, 0] },
  { base_mm = [210, -130, -8], direction_deg = 331, arm_mm = 185, rod_mm = 555, platform_mm = [72, -42, 1], zero_deg = -1 },
]
drive = { angle_min_deg = 60, angle_max_deg = 200 }
tool = { x_mm = 10, length_mm = 30 }
)";
constexpr const char* kFour = R"(
family = "rotary-delta"
base = { radius_mm = 200 }
platform = { radius_mm = 60 }
arm = { length_mm = 250, count = 4, first_deg = 45 }
rod = { length_mm = 600 }
drive = { angle_min_deg = 50, angle_max_deg = 190 }
)";
template <class M>
M text_as(const char* text) {
  const auto m = machine::from_text(text, "test.toml");
  if (!m) throw std::runtime_error(to_string(m.error()));
  return std::get<M>(*m);
}

template <class M>
void check(const M& m, double share) {
  testing::InvariantOptions options;
  options.share = share;
  // Branches in the other assembly mode do not lead back; those within all limits do.
  const auto own_mode = [&](const Pose& X) {
    auto result = inverse(m, X);
    std::erase_if(result.solutions, [](const auto& s) { return s.violations != 0; });
    return result;
  };
  testing::check_invariants(
      m, [&](const JointVector& q) { return forward(m, q); }, own_mode,
      [&](const Pose& X, const JointVector& q) { return jacobian(m, X, q); }, options);
}

TEST(RotaryDelta, KeepsTheInvariants) {
  check(load_as<RotaryDelta>(
            "delta-brno", {{"drive.angle_min_deg", "70"}, {"drive.angle_max_deg", "150"}, {"limits.z_max_mm", "800"}}),
        0.9);
}
TEST(RotaryDelta, KeepsTheInvariantsWithArmsThatDiffer) {
  check(text_as<RotaryDelta>(kGeneral), 0.4);
}
TEST(LinearDelta, KeepsTheInvariants) {
  check(load_as<LinearDelta>("delta-linear"), 0.3);
}
TEST(LinearDelta, KeepsTheInvariantsOnInclinedRails) {
  check(load_as<LinearDelta>("delta-linear", {{"rail.incline_deg", "20"}}), 0.2);
}

/// KOZ (4.31) to (4.33) and (4.34) to (4.36) as printed for three arms at 120 deg: the closure of the machine of Table
/// 4-2, with k = m = 120 deg between the arms.
TEST(RotaryDelta, ElbowsOfTheSource) {
  const auto m = load_as<RotaryDelta>("delta-brno");
  const double k = 2 * std::numbers::pi / 3, right = std::numbers::pi / 2, d = 0.1799;
  for (double theta = 0.8; theta < 4.5; theta += 0.3) {
    const double s = std::sin(theta) * d, c = std::cos(theta) * d;
    EXPECT_LT((driven_end(m, 0, theta) - Vec3(0, 0.25 + s, -c)).norm(), 1e-12);
    EXPECT_LT(
        (driven_end(m, 1, theta) - Vec3(-0.2165064 - s * std::cos(k - right), -0.125 - s * std::sin(k - right), -c))
            .norm(),
        1e-7);  // the table has seven digits
    EXPECT_LT(
        (driven_end(m, 2, theta) - Vec3(0.2165064 + s * std::cos(k - right), -0.125 - s * std::sin(k - right), -c))
            .norm(),
        1e-7);
  }
}

/// One arm at the middle, by hand: X on the axis at z, triangle of arm, rod and the line from base to platform joint.
TEST(RotaryDelta, OnTheAxisByTheLawOfCosines) {
  const auto m = load_as<RotaryDelta>("delta-brno");
  for (double z = 0.4; z < 0.66; z += 0.02) {
    const double r = 0.25 - 0.0826, D = std::hypot(r, z);
    const double at_base = std::acos((D * D + 0.1799 * 0.1799 - 0.5539 * 0.5539) / (2 * D * 0.1799));
    const double theta = std::numbers::pi + std::atan2(r, z) - at_base;
    double q[3];
    ASSERT_TRUE(drive_positions(m, Vec3(0, 0, z), q));
    for (const double angle : q) EXPECT_NEAR(angle, theta, 1e-12);
  }
}

TEST(RotaryDelta, ForwardUndoesInverseByBothMethods) {
  constexpr double kClose = 1e-12;  // 1e-9 mm; rounding leaves less than 1e-15 m here
  const auto m = load_as<RotaryDelta>("delta-brno");
  std::mt19937 random(20261121);
  std::uniform_real_distribution<double> across(-0.3, 0.3), down(0.40, 0.62);
  for (int poses = 0; poses < 1'000'000;) {
    const Vec3 X(across(random), across(random), down(random));
    JointVector q(3);
    if (!drive_positions(m, X, q.data())) continue;
    const Pose back = forward(m, q);
    ASSERT_LT((back.p - X).norm(), kClose) << X.transpose();
    if (++poses % 50 != 0) continue;
    const auto newton = forward_from(m, q, Pose{Mat3::Identity(), X + Vec3(0.01, -0.01, 0.01)});
    ASSERT_TRUE(newton.converged) << X.transpose();
    ASSERT_LT((newton.X_MT.p - back.p).norm(), kClose);
    ASSERT_LE(newton.iterations, 7);
  }
}

TEST(RotaryDelta, BothPosesCloseAndAreMirrorImages) {
  const auto m = text_as<RotaryDelta>(kGeneral);
  const std::vector<double> p = kinematics::nominal_parameters(m);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> angle(m.range.min, m.range.max);
  for (int k = 0; k < 1000; ++k) {
    JointVector q(3);
    for (int i = 0; i < 3; ++i) q[i] = angle(random);
    const auto both = both_poses(m, q);
    if (!both.real) continue;
    EXPECT_GE(both.machine.z(), both.other.z());
    for (const Vec3& X : {both.machine, both.other}) {
      const auto F =
          closure(m, Pose{Mat3::Identity(), X}, std::span<const double>(q.data(), 3), std::span<const double>(p));
      EXPECT_LT(F.cwiseAbs().maxCoeff(), 1e-12);
    }
  }
}

TEST(RotaryDelta, EveryBranchCloses) {
  const auto m = load_as<RotaryDelta>("delta-brno");
  const std::vector<double> p = kinematics::nominal_parameters(m);
  const Pose X{Mat3::Identity(), Vec3(0.2, -0.2, 0.45)};
  const auto solutions = inverse(m, X).solutions;
  ASSERT_EQ(solutions.size(), 8U);
  EXPECT_EQ(branch_name(m, solutions.front().branch), "outer");
  EXPECT_EQ(branch_name(m, solutions[5].branch), "inner at 1, 3");
  for (const auto& s : solutions) {
    const auto F = closure(m, X, std::span<const double>(s.joints.data(), 3), std::span<const double>(p));
    EXPECT_LT(F.cwiseAbs().maxCoeff(), 1e-12);
    for (int i = 0; i < 3; ++i) {  // the outer elbow is the one farther from the axis
      const double outer = driven_end(m, i, solutions.front().joints[i]).dot(m.outward[i]);
      EXPECT_GE(outer, driven_end(m, i, s.joints[i]).dot(m.outward[i]) - 1e-12);
    }
  }
}

/// KOZ (4.43) and (4.44) from the angles of Figure 4-30, and the general form.
TEST(RotaryDelta, JacobiansOfTheSource) {
  const auto m = load_as<RotaryDelta>("delta-brno");
  std::mt19937 random(7);
  std::uniform_real_distribution<double> across(-0.25, 0.25), down(0.40, 0.62);
  for (int k = 0; k < 1000; ++k) {
    const Vec3 X(across(random), across(random), down(random));
    JointVector q(3);
    if (!drive_positions(m, X, q.data())) continue;
    const auto pair = jacobians(m, X, q);
    for (int i = 0; i < 3; ++i) {
      const auto a = chain_angles(m, i, X, q[i]);
      const double sum = a.theta_1 + a.theta_2, s3 = std::sin(a.theta_3), c3 = std::cos(a.theta_3);
      EXPECT_NEAR(pair.A(i, 0), s3 * std::cos(sum) * std::cos(a.phi) + c3 * std::sin(a.phi), 1e-12);
      EXPECT_NEAR(pair.A(i, 1), -s3 * std::cos(sum) * std::sin(a.phi) + c3 * std::cos(a.phi), 1e-12);
      EXPECT_NEAR(pair.A(i, 2), s3 * std::sin(sum), 1e-12);
      EXPECT_NEAR(pair.B[i], 0.1799 * std::sin(a.theta_2) * s3, 1e-12);
    }
    // A v = B dq/dt against differences of the inverse.
    const double h = 1e-6;
    for (int axis = 0; axis < 3; ++axis) {
      JointVector plus(3), minus(3);
      drive_positions(m, X + h * Vec3::Unit(axis), plus.data());
      drive_positions(m, X - h * Vec3::Unit(axis), minus.data());
      for (int i = 0; i < 3; ++i) {
        const double rate = (plus[i] - minus[i]) / (2 * h);
        EXPECT_NEAR(pair.A(i, axis), pair.B[i] * rate, 1e-7 * (1 + std::abs(rate)));
      }
    }
  }
}

TEST(RotaryDelta, FourArmsAgree) {
  const auto m = text_as<RotaryDelta>(kFour);
  EXPECT_EQ(mobility(m).degrees, 3);
  std::mt19937 random(9);
  std::uniform_real_distribution<double> across(-0.15, 0.15), down(0.5, 0.7);
  for (int k = 0; k < 200; ++k) {
    const Vec3 X(across(random), across(random), down(random));
    JointVector q(4);
    ASSERT_TRUE(drive_positions(m, X, q.data()));
    const auto both = both_poses(m, q);
    EXPECT_LT((both.machine - X).norm(), 1e-11);
    EXPECT_LT(std::abs(both.mismatch), 1e-11);
    const auto newton = forward_from(m, q, machine::home_pose(m));
    EXPECT_TRUE(newton.converged);
    EXPECT_LT((newton.X_MT.p - X).norm(), 1e-11);
    // Along the machine's own motion the redundant Jacobian is exact.
    const Vec3 v(across(random), across(random), across(random));
    const auto pair = jacobians(m, X, q);
    const JointVector rate = (pair.A * v).cwiseQuotient(pair.B);
    EXPECT_LT((jacobian(m, Pose{Mat3::Identity(), X}, rate.size() == 4 ? q : rate).topRows<3>() * rate - v).norm(),
              1e-10);
  }
  JointVector q(4);
  drive_positions(m, Vec3(0, 0, 0.6), q.data());
  q[3] += 0.01;
  EXPECT_TRUE(kinematics::forward_all(machine::AnyMachine(m), q).poses.empty()) << "the fourth drive does not fit";
}

TEST(Trilateration, TouchingAndApart) {
  const std::array<Vec3, 3> center{Vec3(1, 0, 0), Vec3(0, 1, 0), Vec3(-1, -1, 0)};
  const auto far = trilaterate(center, {0.1, 0.1, 0.1});
  EXPECT_FALSE(far.real());
  EXPECT_TRUE(far.above.allFinite());
  const auto line = trilaterate({Vec3(0, 0, 0), Vec3(1, 0, 0), Vec3(2, 0, 0)}, {1, 1, 1});
  EXPECT_FALSE(line.real());
  EXPECT_TRUE(line.above.allFinite());
}

/// Every limit is found broken by a pose made for it, and named.
TEST(RotaryDelta, LimitsAreNamed) {
  const auto broken = [](const std::vector<machine::Override>& sets, const Vec3& X) {
    const machine::AnyMachine m = *machine::load("delta-picker", sets);
    const auto solutions = kinematics::inverse(m, Pose{Mat3::Identity(), X}).solutions;
    return solutions.empty() ? std::vector<std::string>{"none"}
                             : kinematics::limit_names(m, solutions.front().violations);
  };
  const Vec3 X(0, 0.3, 0.9);
  EXPECT_THAT(broken({}, X), ::testing::IsEmpty());
  EXPECT_THAT(broken({{"drive.angle_min_deg", "120"}}, X), ::testing::Contains("arm 1 below its smallest angle"));
  EXPECT_THAT(broken({{"drive.angle_max_deg", "80"}}, Vec3(0, 0, 0.95)),
              ::testing::Contains("arm 1 above its largest angle"));
  EXPECT_THAT(broken({{"joint.side_deg", "15"}}, X), ::testing::Contains("rod 2 too far aside for its ball joints"));
  EXPECT_THAT(broken({{"joint.platform_deg", "30"}}, X), ::testing::Contains("rod 3 too flat against the platform"));
  EXPECT_THAT(broken({{"joint.elbow_min_deg", "89"}}, X), ::testing::Contains("elbow 2 beyond its limit"));
  EXPECT_THAT(broken({{"limits.y_max_mm", "200"}}, X), ::testing::Contains("y above its largest value"));
  EXPECT_THAT(broken({{"limits.z_min_mm", "950"}}, X), ::testing::Contains("z below its smallest value"));
  EXPECT_THAT(broken({{"rod.diameter_mm", "300"}}, X), ::testing::Contains("rods 1 and 2 collide"));
}

TEST(Delta, BadFilesAreRefused) {
  const auto id = [](const char* name, const std::vector<machine::Override>& sets) {
    const auto m = machine::load(name, sets);
    return m ? std::string("none") : m.error().id;
  };
  EXPECT_EQ(id("delta-brno", {{"rod.length_mm", "100"}, {"base.radius_mm", "400"}}), "MA144");  // too short to close
  EXPECT_EQ(id("delta-linear", {{"rod.length_mm", "100"}}), "MA144");
  EXPECT_EQ(id("delta-brno", {{"drive.angle_min_deg", "260"}}), "MA141");  // empty range
  EXPECT_EQ(id("delta-brno", {{"drive.angle_min_deg", "300"}}), "MA141");
  EXPECT_EQ(id("delta-brno", {{"limits.z_min_mm", "700"}}), "MA142");
  EXPECT_EQ(id("delta-brno", {{"arm.count", "5"}}), "CF105");
  EXPECT_EQ(id("delta-brno", {{"arm.lenght_mm", "5"}}), "CF103");
}

TEST(Delta, FilesComeBack) {
  for (const machine::AnyMachine& m :
       {*machine::load("delta-brno"), *machine::load("delta-picker"), *machine::load("delta-linear"),
        *machine::from_text(kGeneral, "a.toml"), *machine::from_text(kFour, "b.toml")}) {
    const std::string text = machine::to_toml(m);
    const auto again = machine::from_text(text, "again.toml");
    ASSERT_TRUE(again) << text;
    EXPECT_EQ(machine::to_toml(*again), text);
  }
}

TEST(Delta, GrueblersCount) {  // KOZ (4.2): 3 = 6 (11 - 15 - 1) + 39 - 6 + 0
  const auto count = mobility(load_as<RotaryDelta>("delta-brno"));
  EXPECT_EQ(count.members, 11);
  EXPECT_EQ(count.joints, 15);
  EXPECT_EQ(count.freedoms, 39);
  EXPECT_EQ(count.idle, 6);
  EXPECT_EQ(count.degrees, 3);
}

}  // namespace
}  // namespace polypod
