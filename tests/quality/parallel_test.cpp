// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Errors, compliance and singular poses of machines of legs: against the built-in hexapod, differences and geometry.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "machines.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/families.hpp"
#include "polypod/quality/elements.hpp"
#include "polypod/quality/errors.hpp"
#include "polypod/quality/singularity.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod {
namespace {

using kinematics::JointVector;
using machine::AnyMachine;

std::string list(const Vec3& p) {
  return fmt::format("[{:.17g}, {:.17g}, {:.17g}]", units::to_mm(p.x()), units::to_mm(p.y()), units::to_mm(p.z()));
}

/// hexapod-strut and the same as a file of legs, their struts giving way by 0.01 to 0.06 um/N.
std::pair<AnyMachine, AnyMachine> both() {
  AnyMachine built_in = test::load("hexapod-strut");
  auto& m = std::get<machine::StrutHexapod>(built_in);
  std::string text = fmt::format("family = \"parallel\"\nhome = {{ z_mm = {} }}\ntool = {{ z_mm = {} }}\n",
                                 units::to_mm(home_pose(m).p.z()), units::to_mm(m.tool_length));
  for (std::size_t i = 0; i < 6; ++i) {
    m.leg_compliance[i] = units::from_um(0.01 * double(i + 1));
    text += fmt::format(
        "[[leg]]\ndrive = \"strut\"\nbase_mm = {}\nplatform_mm = {}\nmin_mm = {}\nmax_mm = {}\ncompliance_um_per_N = "
        "{}\n",
        list(m.base_joint[i]), list(m.platform_joint[i]), units::to_mm(m.length_min), units::to_mm(m.length_max),
        0.01 * double(i + 1));
  }
  const auto legs = machine::from_text(text, "legs.toml");
  if (!legs) throw std::runtime_error(to_string(legs.error()));
  return {built_in, *legs};
}

const Pose kPose{rotation_abc(0.1, -0.15, 0.2), {0.004, -0.003, 0.078}};

TEST(ErrorsOfLegs, AreThoseOfTheHexapod) {
  const auto [m, legs] = both();
  const JointVector q = kinematics::inverse(m, kPose).solutions.at(0).joints;
  for (const char* key : {"all", "leg.length", "base.joint[2]", "platform.attachment", "platform.joint[5].x"}) {
    const auto a = quality::sized(m, {{key, 0.01}}, true), b = quality::sized(legs, {{key, 0.01}}, true);
    ASSERT_TRUE(a && b) << key;
    ASSERT_EQ(a->size(), b->size()) << key;
    const auto worst = quality::worst_case(m, kPose, q, *a), same = quality::worst_case(legs, kPose, q, *b);
    ASSERT_TRUE(worst && same) << key;
    EXPECT_NEAR(worst->position, same->position, 1e-9 * worst->position) << key;
    EXPECT_NEAR(worst->orientation, same->orientation, 1e-9 * worst->orientation) << key;
  }
}

TEST(ComplianceOfLegs, IsThatOfTheHexapod) {
  const auto [m, legs] = both();
  const Mat6 a = statics::compliance_at(m, kPose).C, b = statics::compliance_at(legs, kPose).C;
  EXPECT_GT(a.norm(), 0);
  EXPECT_LT((a - b).norm(), 1e-9 * a.norm());
}

/// The force on the tip does the work that the legs take up: with the forces in the legs from the balance of the
/// platform, sum f_i^2 c_i = F^T C F, at poses whose orientation follows.
TEST(ComplianceOfLegs, TakesUpTheWorkOfTheForce) {
  for (const char* name : {"tricept", "tripod-z3", "pentapod", "hexa"}) {
    const AnyMachine any = test::load(name);
    const auto& m = std::get<machine::Parallel>(any);
    std::vector<double> c = kinematics::coordinates_of(m.task, m.home);
    for (double& x : c) x += 0.04;
    const Pose target = kinematics::pose_of(m.task, c);
    const statics::Compliance found = statics::compliance_at(any, target);
    ASSERT_TRUE(found.reachable) << name << ": " << found.reason;
    EXPECT_LT((found.X_MT.p - kinematics::settled(any, target)->p).norm(), 1e-12);
    const machine::EquationRows rows = closure_rows(m, found.X_MT, found.joints);
    ASSERT_EQ(rows.A.rows(), 6) << name;
    Vec6 wrench;
    wrench << 30, -20, 50, 0, 0, 0;
    const Vec6 multipliers = Mat6(rows.A).transpose().partialPivLu().solve(wrench);
    double work = 0;
    for (std::size_t i = 0; i < m.legs.size(); ++i) {
      // The row of a leg is its unit direction times length / reference.
      const double force =
          multipliers[static_cast<Eigen::Index>(i)] * rows.A.row(static_cast<Eigen::Index>(i)).head<3>().norm();
      work += force * force * m.legs[i].compliance;
    }
    EXPECT_NEAR(wrench.dot(found.C * wrench), work, 1e-9 * work) << name;
  }
}

TEST(ErrorsOfLegs, AreWhatTheErroneousMachineDoes) {
  for (const char* name : {"tricept", "tripod-z3", "pentapod", "hexa", "planar-3rrr"}) {
    const AnyMachine m = test::load(name);
    const Pose home = *kinematics::home_pose(m);
    const JointVector q = kinematics::inverse(m, home).solutions.at(0).joints;
    for (const char* key : {"leg.length[2]", "base.joint[1].x", "platform.joint[3].y", "joint[1]", "tool.z"}) {
      const auto sized = quality::sized(m, {{key, 0.001}}, false);
      ASSERT_TRUE(sized.has_value()) << name << " " << key;
      const Vec6 linear = quality::known_error(m, home, q, *sized);
      const auto exact = quality::known_error_exact(m, home, q, *sized);
      ASSERT_TRUE(exact.has_value()) << name << " " << key;
      // Second order: the square of 1 um over the shortest length, 0.2 m.
      EXPECT_LT((linear - *exact).norm(), 1e-4 * exact->norm() + 5e-12) << name << " " << key;
    }
  }
}

/// The three rods of the planar machine lie on lines through the middle where arms and platform are turned so that the
/// moment of each rod about it vanishes: then the platform turns there though the drives stand.
TEST(SingularLegs, PlanarMachineWhereItsRodsMeetInAPoint) {
  const AnyMachine any = test::load("planar-3rrr");
  const auto& m = std::get<machine::Parallel>(any);
  const auto moment = [&](double angle) {
    const Pose X{rotation_z(angle), Vec3::Zero()};
    const JointVector q = *joints_of(m, X);
    const Vec3 elbow = leg_anchor(m.legs[0], q[0]), joint = leg_end(m, m.legs[0], X);
    return elbow.cross(joint - elbow).z();
  };
  double low = 0, high = 0;
  for (double angle = -1.5; angle < 1.5; angle += 0.05) {
    if (moment(angle) * moment(angle + 0.05) > 0) continue;
    low = angle;
    high = angle + 0.05;
    break;
  }
  ASSERT_NE(low, high) << "no angle at which the rods meet in the middle";
  for (int k = 0; k < 60; ++k) {
    const double middle = 0.5 * (low + high);
    (moment(low) * moment(middle) > 0 ? low : high) = middle;
  }
  const Pose X{rotation_z(low), Vec3::Zero()};
  const quality::Singularity s = quality::singularity(any, X, *joints_of(m, X));
  EXPECT_LT(s.control, 1e-8);
  EXPECT_EQ(s.kind & 2, 2);
  EXPECT_LT(s.free_motion.head<3>().norm(), 1e-6 * s.free_motion.tail<3>().norm());
  EXPECT_NEAR(std::abs(s.free_motion.tail<3>().normalized().z()), 1, 1e-9);
  ASSERT_TRUE(s.constraints.has_value());
  EXPECT_GT(*s.constraints, 0.1);  // the plane still holds
  const Pose away{rotation_z(low + 0.2), Vec3::Zero()};
  EXPECT_GT(quality::singularity(any, away, *joints_of(m, away)).control, 0.01);
}

/// The tube of a Tricept through the joint at the origin: with the tip at the joint nothing keeps the platform's tilt.
TEST(SingularLegs, ConstraintsThatLetGoAreNamed) {
  const auto m = machine::from_text(R"(family = "parallel"
task = ["z"]
home = { z_mm = 500 }
leg = [{ drive = "strut", base_mm = [0, 0, 0], platform_mm = [0, 0, 0], min_mm = 1, max_mm = 900 }]
constraint = [
  { kind = "line", platform_mm = [0, 0, 0], axis = [0, 0, 1], base_mm = [0, 0, 0] },
  { kind = "square", base_axis = [1, 0, 0], platform_axis = [0, 1, 0] },
  { kind = "plane", platform_mm = [0, 0, 0], base_mm = [0, 0, 0], normal = [1, 0, 0] },
  { kind = "plane", platform_mm = [0, 0, 0], base_mm = [0, 0, 0], normal = [0, 1, 0] },
]
)",
                                    "tube.toml");
  ASSERT_TRUE(m.has_value()) << to_string(m.error());
  const auto at = [&](double z) {
    JointVector q(1);
    q[0] = z;
    return quality::singularity(*m, Pose{Mat3::Identity(), {0, 0, z}}, q, 0.5);
  };
  EXPECT_GT(*at(0.5).constraints, 0.1);
  const quality::Singularity s = at(1e-6);
  EXPECT_LT(*s.constraints, 1e-4);
  EXPECT_EQ(s.kind & 2, 2);
  EXPECT_NE(quality::in_words(Pose{}, s).find("constraints"), std::string::npos);
}

// Constraints hold exactly: the least constrained motion is one that they allow, with the rods alone against it. Two
// rods along (0.8, 0.6) and (-0.8, 0.6) hold z least, by sqrt(2) 0.6; the platform cannot turn, whatever turning would
// cost.
TEST(SingularLegs, ExactConstraintsAreNotWeighedAgainstTheLegs) {
  const auto m = machine::from_text(R"(family = "parallel"
task = ["x", "z"]
home = { z_mm = 400 }
leg = [
  { drive = "rail", base_mm = [0, 0, 0], rail = [1, 0, 0], rod_mm = 500, platform_mm = [-50, 0, 0], min_mm = -800, max_mm = -60 },
  { drive = "rail", base_mm = [0, 0, 0], rail = [1, 0, 0], rod_mm = 500, platform_mm = [50, 0, 0], min_mm = 60, max_mm = 800 },
]
constraint = [ { kind = "orientation" }, { kind = "plane", platform_mm = [0, 0, 0], base_mm = [0, 0, 0], normal = [0, 1, 0] } ]
)",
                                    "sliders.toml");
  ASSERT_TRUE(m.has_value()) << to_string(m.error());
  const Pose X{Mat3::Identity(), {0.1, 0, 0.3}};
  const auto inverse = kinematics::inverse(*m, X);
  ASSERT_NE(inverse.reachable(), nullptr);
  for (const double length : {0.0, 0.05, 3.0}) {
    const quality::Singularity s = quality::singularity(*m, X, inverse.reachable()->joints, length);
    EXPECT_NEAR(s.control, std::sqrt(2.0) * 0.6, 1e-9) << length;
    EXPECT_NEAR(std::abs(s.free_motion[2]), s.free_motion.norm(), 1e-9) << length;
  }
}

}  // namespace
}  // namespace polypod
