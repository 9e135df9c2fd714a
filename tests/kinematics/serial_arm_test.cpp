// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/serial/kinematics.hpp"

#include <gmock/gmock.h>

#include <set>

#include "kinematics/invariants.hpp"
#include "machines.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod {
namespace {

using machine::SerialArm;
using test::arm_of;
using testing::check_invariants;

SerialArm lola() {
  return std::get<SerialArm>(*machine::load("lola50"));
}

void check(const SerialArm& arm, const testing::InvariantOptions& options = {}) {
  check_invariants(
      arm, [&](const machine::JointVector& q) { return machine::forward(arm, q); },
      [&](const Pose& X) { return machine::inverse(arm, X); },
      [&](const Pose& X, const machine::JointVector& q) { return machine::jacobian(arm, X, q); }, options);
}

TEST(SerialArm, LolaKeepsTheInvariants) {
  const SerialArm arm = lola();
  EXPECT_TRUE(machine::has_closed_inverse(arm));
  check(arm);
}

// The same robot with its sixth joint in the table and locked (SLAV 2.2), on a base that is turned and moved.
constexpr const char* kLolaLocked = R"(
family = "serial"
task = "axis"
dh = [ {alpha_deg=90, theta_offset_deg=-90}, {a_mm=850, theta_offset_deg=90}, {alpha_deg=90},
       {alpha_deg=-90, d_mm=1100, sign=-1}, {alpha_deg=90, theta_offset_deg=90}, {d_mm=407, theta_offset_deg=0} ]
locked = { 6 = 30 }
base = { x_mm = 100, y_mm = -50, z_mm = 20, c_deg = 25 }
tool = { a_deg = 180 }
limits = [ {min_deg=-90,max_deg=90}, {min_deg=-61,max_deg=43}, {min_deg=-38,max_deg=89}, {min_deg=-170,max_deg=170},
           {min_deg=-30,max_deg=89} ]
)";

TEST(SerialArm, SixJointsWithOneLockedHaveTheClosedInverse) {
  const SerialArm arm = arm_of(kLolaLocked);
  ASSERT_EQ(arm.free_joints(), 5);
  ASSERT_TRUE(machine::has_closed_inverse(arm));
  check(arm);
}

constexpr const char* kPumaModified = R"(
family = "serial"
convention = "modified"
dh = [ {}, {alpha_deg=-90}, {a_mm=431.8, d_mm=149.09}, {a_mm=-20.32, alpha_deg=-90, d_mm=433.07}, {alpha_deg=90}, {alpha_deg=-90} ]
tool = { z_mm = 100 }
limits = [ {min_deg=-160,max_deg=160}, {min_deg=-225,max_deg=45}, {min_deg=-45,max_deg=225}, {min_deg=-110,max_deg=170},
           {min_deg=-100,max_deg=-5}, {min_deg=-170,max_deg=170} ]
)";

// KUKA KR 270 R2700: the lengths and ranges of its data sheet, a spindle across the flange.
constexpr const char* kKr270 = R"(
family = "serial"
dh = [ {a_mm=350, alpha_deg=-90, d_mm=675}, {a_mm=1150}, {a_mm=-41, alpha_deg=-90}, {alpha_deg=90, d_mm=1200},
       {alpha_deg=-90}, {d_mm=215} ]
base = { x_mm = 300, y_mm = -200, z_mm = 50, c_deg = 40 }
tool = { x_mm = 250, z_mm = 180, b_deg = -90 }
limits = [ {min_deg=-185,max_deg=185}, {min_deg=-140,max_deg=-5}, {min_deg=-210,max_deg=155}, {min_deg=-350,max_deg=350},
           {min_deg=-122.5,max_deg=122.5}, {min_deg=-350,max_deg=350} ]
)";
// The same kind with other senses, zeros and a forearm that is bent the other way.
constexpr const char* kReversed = R"(
family = "serial"
dh = [ {a_mm=175, alpha_deg=90, d_mm=495, sign=-1}, {a_mm=900, theta_offset_deg=90}, {a_mm=175, alpha_deg=90, sign=-1},
       {alpha_deg=-90, d_mm=960, sign=-1}, {alpha_deg=90, theta_offset_deg=15}, {d_mm=135, sign=-1} ]
tool = { z_mm = 120, a_deg = 180 }
limits = [ {min_deg=-180,max_deg=180}, {min_deg=-90,max_deg=150}, {min_deg=-180,max_deg=75}, {min_deg=-300,max_deg=300},
           {min_deg=-130,max_deg=130}, {min_deg=-360,max_deg=360} ]
)";

class SphericalWrist : public ::testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(Arms, SphericalWrist, ::testing::Values(kPumaModified, kKr270, kReversed));

TEST_P(SphericalWrist, KeepsTheInvariants) {
  const SerialArm arm = arm_of(GetParam());
  ASSERT_TRUE(machine::has_closed_inverse(arm));
  testing::InvariantOptions options;
  options.share = 0.45;  // of ranges of up to two turns, so that the joints are those in (-180, 180] deg
  check(arm, options);
}

TEST_P(SphericalWrist, PosturesOfOnePose) {
  const SerialArm arm = arm_of(GetParam());
  const machine::JointVector middle = machine::JointVector::Constant(6, 0.3);
  machine::JointVector q(6);
  for (int i = 0; i < 6; ++i) {
    const auto range = machine::joint_range(arm, i);
    q[i] = 0.5 * (range.min + range.max) + 0.1 * middle[i];
  }
  const Pose X = machine::forward(arm, q);
  const auto result = machine::inverse(arm, X);
  ASSERT_GE(result.solutions.size(), 4u);  // the posture over the back does not reach everywhere
  std::set<std::string> names;
  for (const kinematics::Solution& s : result.solutions) {
    names.insert(machine::branch_name(arm, s.branch));
    const Pose back = machine::forward(arm, s.joints);
    EXPECT_LT((back.p - X.p).norm() + (back.R - X.R).norm(), 1e-10) << s.branch;
  }
  EXPECT_EQ(names.size(), result.solutions.size());
  // The numeric search, which knows nothing of wrists, finds no other.
  kinematics::DampedOptions more;
  more.seeds = 100;
  const auto numeric = kinematics::inverse_damped(
      arm, X, [&](const machine::JointVector& at) { return machine::forward(arm, at); },
      [&](const Pose& at, const machine::JointVector& joints) { return machine::jacobian(arm, at, joints); }, more);
  EXPECT_GE(numeric.solutions.size(), 2u);
  for (const kinematics::Solution& n : numeric.solutions) {
    const bool known = std::any_of(result.solutions.begin(), result.solutions.end(),
                                   [&](const auto& s) { return test::apart(s.joints, n.joints) < 1e-6; });
    EXPECT_TRUE(known) << n.joints.transpose();
  }
}

// A way of the joints on which joints 4 and 6 turn past half a turn where they may: its poses give the same joints
// back.
TEST_P(SphericalWrist, APostureIsKeptAlongAPath) {
  const machine::AnyMachine arm(arm_of(GetParam()));
  const auto& serial = std::get<SerialArm>(arm);
  const auto at = [&](double share) {
    machine::JointVector q(6);
    for (int i = 0; i < 6; ++i) {
      const auto range = machine::joint_range(serial, i);
      q[i] = range.min + (0.55 + 0.4 * share) * (range.max - range.min);
    }
    return q;
  };
  machine::JointVector last = at(0);
  for (int k = 1; k <= 500; ++k) {
    const machine::JointVector q = at(k / 500.0);
    const auto next = kinematics::inverse_near(arm, machine::forward(serial, q), last);
    ASSERT_FALSE(next.solutions.empty());
    EXPECT_LT((next.solutions[0].joints - q).cwiseAbs().maxCoeff(), 1e-7) << k;
    last = q;
  }
}

TEST(SphericalWrist, SingularPosesAreMarked) {
  const SerialArm arm = arm_of(kKr270);
  machine::JointVector q(6);
  q << 0.2, -1.2, 0.4, 0.7, 0, -0.3;  // axes 4 and 6 in line
  const Pose X = machine::forward(arm, q);
  const auto result = machine::inverse(arm, X);
  ASSERT_FALSE(result.solutions.empty());
  EXPECT_TRUE(result.solutions[0].singular);
  for (const kinematics::Solution& s : result.solutions) {
    const Pose back = machine::forward(arm, s.joints);
    EXPECT_LT((back.p - X.p).norm() + (back.R - X.R).norm(), 1e-8) << s.branch;
  }
}

// An arm like the UR5, whose axes 5 and 6 pass each other by 30 mm: no closed form, so the inverse is numeric.
constexpr const char* kOffsetWrist = R"(
family = "serial"
dh = [ {d_mm=89.159, alpha_deg=90}, {a_mm=-425}, {a_mm=-392.25}, {d_mm=109.15, alpha_deg=90},
       {d_mm=94.65, alpha_deg=-90, a_mm=30}, {d_mm=82.3} ]
limits = [ {min_deg=-160,max_deg=160}, {min_deg=-160,max_deg=-20}, {min_deg=20,max_deg=150}, {min_deg=-170,max_deg=170},
           {min_deg=20,max_deg=150}, {min_deg=-170,max_deg=170} ]
)";

TEST(SerialArm, AWristWithOffsetsHasANumericInverse) {
  const SerialArm arm = arm_of(kOffsetWrist);
  EXPECT_FALSE(machine::has_closed_inverse(arm));
  testing::InvariantOptions options;
  options.samples = 25;
  check_invariants(
      arm, [&](const machine::JointVector& q) { return machine::forward(arm, q); },
      [&](const Pose& X) {
        kinematics::DampedOptions more;
        more.seeds = 400;  // the generating branch must be among those found
        return kinematics::inverse_damped(
            arm, X, [&](const machine::JointVector& q) { return machine::forward(arm, q); },
            [&](const Pose& at, const machine::JointVector& q) { return machine::jacobian(arm, at, q); }, more);
      },
      [&](const Pose& X, const machine::JointVector& q) { return machine::jacobian(arm, X, q); }, options);
}

// A SCARA: a prismatic joint, a task of position only would do; here x, y, z.
TEST(SerialArm, PrismaticJoint) {
  const SerialArm arm = arm_of(R"(
family = "serial"
task = "point"
dh = [ {a_mm=300}, {a_mm=250, alpha_deg=180}, {joint="prismatic"} ]
limits = [ {min_deg=-90,max_deg=90}, {min_deg=10,max_deg=150}, {min_mm=0,max_mm=200} ]
)");
  check(arm);
}

// SLAV (4.44): the Jacobian at x_M = (0, -1300, 0) mm, A = B = 0, to the digits printed.
TEST(SerialArm, JacobianOfEquation4_44) {
  const auto lola50 = *machine::load("lola50");
  const auto result = kinematics::inverse(lola50, kinematics::pose_of(machine::Task::axis, {0, -1.3, 0}));
  ASSERT_NE(result.reachable(), nullptr);
  const machine::JointVector q = result.reachable()->joints;
  EXPECT_EQ(kinematics::branch_name(lola50, result.reachable()->branch), "front elbow-up");
  const double expected_deg[5] = {0, -18.80, -2.39, 0, 21.18};
  // The lengths are known to half a millimetre only, which moves these joints by up to 0.05 deg.
  for (int i = 0; i < 5; ++i) EXPECT_NEAR(units::to_deg(q[i]), expected_deg[i], 0.05) << i;
  const Eigen::MatrixXd J = kinematics::task_jacobian(
      machine::Task::axis, kinematics::jacobian(lola50, kinematics::pose_of(machine::Task::axis, {0, -1.3, 0}), q),
      kinematics::pose_of(machine::Task::axis, {0, -1.3, 0}));
  Eigen::Matrix<double, 5, 5> printed;
  printed << 1.3, 0, 0, -0.38, 0, 0, 0, -0.805, 0, -0.407, 0, 1.3, 1.026, 0, 0, 0, -1, -1, 0, -1, 0, 0, 0, 0.932, 0;
  // Half of the last printed digit: the third decimal, but the second for -0.38.
  Eigen::Matrix<double, 5, 5> half_digit = Eigen::Matrix<double, 5, 5>::Constant(5e-4);
  half_digit(0, 3) = 5e-3;
  EXPECT_TRUE(((J - printed).cwiseAbs().array() <= half_digit.array()).all()) << J;
}

TEST(SerialArm, MoreJointsThanCoordinatesHaveAManipulability) {
  const auto arm = machine::from_text(R"(family = "serial"
convention = "standard"
dh = [ { d_mm = 340, alpha_deg = -90 }, { alpha_deg = 90 }, { d_mm = 400, alpha_deg = 90 }, { alpha_deg = -90 },
  { d_mm = 400, alpha_deg = -90 }, { alpha_deg = 90 }, { d_mm = 126 } ]
)",
                                      "seven.toml");
  ASSERT_TRUE(arm);
  const machine::JointVector q = (machine::JointVector(7) << 0.3, 0.7, -0.4, -1.2, 0.5, 0.9, 0.1).finished();
  const Pose X = kinematics::forward(*arm, q).poses.front();
  const Mat6 JJ = [&] {
    const Eigen::MatrixXd J = kinematics::jacobian(*arm, X, q);
    return Mat6(J * J.transpose());
  }();
  ASSERT_GT(JJ.determinant(), 1e-6);
  EXPECT_NEAR(kinematics::dexterity(*arm, X, q).determinant, std::sqrt(JJ.determinant()), 1e-12);
  // Stretched, with the wrist straight, it is singular.
  const machine::JointVector zero = machine::JointVector::Zero(7);
  EXPECT_LT(kinematics::dexterity(*arm, kinematics::forward(*arm, zero).poses.front(), zero).determinant, 1e-12);
}

TEST(SerialArm, ForwardMatchesEquation2_17) {
  const SerialArm arm = lola();
  const double a2 = 0.85, d4 = 1.1, a5 = 0.407;
  for (int k = 0; k < 50; ++k) {
    machine::JointVector q(5);
    for (int i = 0; i < 5; ++i) q[i] = 0.5 * std::sin(1.7 * k + 2.1 * i);
    const double t1 = q[0], t2 = q[1], t23 = q[1] + q[2], t4 = q[3], t5 = q[4];
    const double s1 = std::sin(t1), c1 = std::cos(t1), s23 = std::sin(t23), c23 = std::cos(t23), s4 = std::sin(t4),
                 c4 = std::cos(t4), s5 = std::sin(t5), c5 = std::cos(t5);
    const Vec3 axis(-s1 * s23 * c4 * c5 + c1 * s4 * c5 - s1 * c23 * s5,
                    c1 * s23 * c4 * c5 + s1 * s4 * c5 + c1 * c23 * s5, c23 * c4 * c5 - s23 * s5);
    const double out = d4 * c23 - a2 * std::sin(t2);
    const Vec3 tip(-a5 * axis.x() + s1 * out, -a5 * axis.y() - c1 * out, -a5 * axis.z() + d4 * s23 + a2 * std::cos(t2));
    const Pose X = machine::forward(arm, q);
    EXPECT_LT((X.p - tip).norm(), 1e-12);
    EXPECT_LT((X.R.col(2) - axis).norm(), 1e-12);
  }
}

TEST(SerialArm, OutOfReachSaysWhy) {
  const SerialArm arm = lola();
  const auto result = machine::inverse(arm, kinematics::pose_of(machine::Task::axis, {0, -5, 0}));
  EXPECT_TRUE(result.solutions.empty());
  EXPECT_TRUE(result.converged);
  EXPECT_THAT(result.reason, ::testing::HasSubstr("out of reach"));
}

TEST(SerialArm, NumericInverseReportsThatItDidNotConverge) {
  const SerialArm arm = arm_of(kOffsetWrist);
  const auto result = machine::inverse(arm, Pose{Mat3::Identity(), Vec3(3, 0, 0)});
  EXPECT_TRUE(result.solutions.empty());
  EXPECT_FALSE(result.converged);
  EXPECT_THAT(result.reason, ::testing::HasSubstr("did not converge"));
}

TEST(SerialArm, LimitsAreNamed) {
  const auto lola50 = *machine::load("lola50");
  const auto result = kinematics::inverse(lola50, kinematics::pose_of(machine::Task::axis, {0, -1.0, -1.2}));
  ASSERT_FALSE(result.solutions.empty());
  EXPECT_EQ(result.reachable(), nullptr);
  std::string all;
  for (const auto& s : result.solutions)
    for (const auto& name : kinematics::limit_names(lola50, s.violations)) all += name + ";";
  EXPECT_THAT(all, ::testing::HasSubstr("joint"));
}

TEST(SerialArm, SingularWristIsMarked) {
  // Joint 5 at 90 deg of the axis angle puts the tool along joint 4.
  const SerialArm arm = lola();
  machine::JointVector q(5);
  q << 0.1, -0.2, 0.3, 0.4, units::from_deg(90);
  const Pose X = machine::forward(arm, q);
  const auto result = machine::inverse(arm, X);
  ASSERT_FALSE(result.solutions.empty());
  EXPECT_TRUE(result.solutions.front().singular);
  EXPECT_LT(kinematics::closure_detail::pose_error(machine::Task::axis, X,
                                                   machine::forward(arm, result.solutions.front().joints))
                .norm(),
            1e-9);
}

// SLAV 2.4.4 and FACTS: the box x -600..600, y -1600..-1000, z -400..100 mm at A = B = 0 is wholly inside.
TEST(SerialArm, LolaReachesItsWorkingBox) {
  const SerialArm arm = lola();
  for (int i = 0; i <= 12; ++i)
    for (int j = 0; j <= 6; ++j)
      for (int k = 0; k <= 5; ++k) {
        const Vec3 p(-0.6 + 0.1 * i, -1.6 + 0.1 * j, -0.4 + 0.1 * k);
        EXPECT_NE(machine::inverse(arm, Pose{Mat3::Identity(), p}).reachable(), nullptr) << p.transpose();
      }
}

}  // namespace
}  // namespace polypod
