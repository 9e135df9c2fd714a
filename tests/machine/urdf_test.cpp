// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// URDF: the arm of a file against a product of transforms of its joints, against the same arms of the catalogue, and
// what is refused.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <random>

#include "machines.hpp"
#include "paths.hpp"
#include "polypod/core/units.hpp"
#include "polypod/families/serial/kinematics.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/machine/arm_of_axes.hpp"
#include "polypod/machine/urdf.hpp"

namespace polypod {
namespace {

using machine::JointVector;
using machine::SerialArm;
using test::difference;
using testing::HasSubstr;

constexpr double kPi = std::numbers::pi;
// m, and of rotations: a dozen transforms of some metres, and a rounding of 1e-13 mm and deg of each figure of the
// table.
constexpr double kExact = 1e-12;

const std::string kExamples = test::source("examples/urdf/");

std::string text_of(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

SerialArm arm_of(const std::string& text, const std::string& name = "test.urdf") {
  return test::arm_of(text, name);
}

Error error_of(const std::string& text, const std::string& name = "test.urdf") {
  const auto m = machine::from_text(text, name);
  return m ? Error{"none", "it is read", {}, {}} : m.error();
}

/// One joint of a made-up chain; the test's own way to its transform is that of URDF's definition, with Eigen.
struct MadeJoint {
  std::string type;
  Eigen::Vector3d xyz, rpy, axis;
};

Eigen::Isometry3d transform_of(const MadeJoint& j, double q) {
  Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
  X.translate(j.xyz);
  X.rotate(Eigen::AngleAxisd(j.rpy.z(), Eigen::Vector3d::UnitZ()) *
           Eigen::AngleAxisd(j.rpy.y(), Eigen::Vector3d::UnitY()) *
           Eigen::AngleAxisd(j.rpy.x(), Eigen::Vector3d::UnitX()));
  if (j.type == "prismatic") X.translate(q * j.axis.normalized());
  if (j.type == "revolute" || j.type == "continuous") X.rotate(Eigen::AngleAxisd(q, j.axis.normalized()));
  return X;
}

std::string three(const Eigen::Vector3d& v) {
  return fmt::format("{:.17g} {:.17g} {:.17g}", v.x(), v.y(), v.z());
}

std::string urdf_of(const std::vector<MadeJoint>& joints) {
  std::string out = "<robot name=\"made\"><link name=\"l0\"/>";
  for (std::size_t i = 0; i < joints.size(); ++i) {
    const MadeJoint& j = joints[i];
    out += fmt::format(
        "<link name=\"l{0}\"/>\n<joint name=\"j{0}\" type=\"{1}\"><parent link=\"l{2}\"/><child link=\"l{0}\"/>"
        "<origin xyz=\"{3}\" rpy=\"{4}\"/><axis xyz=\"{5}\"/><limit lower=\"-3\" upper=\"3\" effort=\"1\" "
        "velocity=\"2\"/></joint>",
        i + 1, j.type, i, three(j.xyz), three(j.rpy), three(j.axis));
  }
  return out + "</robot>";
}

/// The largest difference of the arm of a chain from the product of its transforms, the tip turned by half a turn about
/// x.
double off_product(const std::vector<MadeJoint>& joints, const SerialArm& arm, std::mt19937& random) {
  std::uniform_real_distribution<double> value(-3, 3);
  double worst = 0;
  for (int k = 0; k < 10; ++k) {
    JointVector q(arm.free_joints());
    Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
    int next = 0;
    for (const MadeJoint& j : joints) {
      const bool moves = j.type != "fixed";
      if (moves) q[next] = value(random);
      X = X * transform_of(j, moves ? q[next++] : 0);
    }
    X = X * Eigen::AngleAxisd(kPi, Eigen::Vector3d::UnitX());
    worst = std::max(worst, difference(forward(arm, q), Pose{X.linear(), X.translation()}));
  }
  return worst;
}

TEST(Urdf, AnArmIsTheProductOfItsTransforms) {
  constexpr unsigned kSeed = 1;
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> length(-1, 1), angle(-kPi, kPi);
  std::uniform_int_distribution<int> of_ten(0, 9);
  double worst = 0;
  int chains = 0, parallel = 0;
  for (int trial = 0; trial < 2000; ++trial) {
    std::vector<MadeJoint> joints;
    const int count = 1 + of_ten(random) % 8;
    int moving = 0;
    for (int i = 0; i < count; ++i) {
      MadeJoint j;
      const int type = of_ten(random);
      j.type = type < 5 ? "revolute" : type < 6 ? "continuous" : type < 8 ? "prismatic" : "fixed";
      j.xyz = Eigen::Vector3d(length(random), length(random), length(random));
      j.rpy = Eigen::Vector3d(angle(random), angle(random), angle(random));
      j.axis = Eigen::Vector3d(length(random), length(random), length(random) + 0.1);
      switch (of_ten(random)) {  // what real arms have: parallel, opposite, square and meeting axes
        case 0:
        case 1:
          j.rpy.setZero();
          j.axis = Eigen::Vector3d(0, 0, 1);
          ++parallel;
          break;
        case 2:
          j.rpy = Eigen::Vector3d(kPi / 2, 0, 0);
          j.axis = Eigen::Vector3d(0, 0, -1);
          break;
        case 3:
          j.xyz.setZero();
          break;
        case 4:
          j.rpy = Eigen::Vector3d(0, kPi, 0);
          j.axis = Eigen::Vector3d(0, 0, 1);
          break;
        default:
          break;
      }
      moving += j.type != "fixed" ? 1 : 0;
      joints.push_back(j);
    }
    if (moving == 0) continue;
    ++chains;
    const double off = off_product(joints, arm_of(urdf_of(joints)), random);
    ASSERT_LT(off, kExact) << "trial " << trial << ", seed " << kSeed << "\n" << urdf_of(joints);
    worst = std::max(worst, off);
  }
  EXPECT_GT(chains, 1500);
  EXPECT_GT(parallel, 500);
  RecordProperty("worst", fmt::format("{:.2g}", worst));
  fmt::print("{} chains: {:.2g}\n", chains, worst);
}

// q of a joint with <mimic> is multiplier times the joint that it names and offset, along chains of followers, too.
TEST(Urdf, JointsThatFollowOthersAreCoupledRows) {
  std::mt19937 random(4);
  std::uniform_real_distribution<double> length(-1, 1), angle(-kPi, kPi);
  for (int trial = 0; trial < 300; ++trial) {
    std::vector<MadeJoint> joints;
    const int count = 3 + trial % 4;
    std::vector<int> leader(static_cast<std::size_t>(count), -1);
    std::vector<double> multiplier(leader.size(), 1), offset(leader.size(), 0);
    for (int i = 0; i < count; ++i) {
      const bool square = random() % 3 == 0;
      joints.push_back({"continuous", Eigen::Vector3d(length(random), length(random), length(random)),
                        square ? Eigen::Vector3d::Zero() : Eigen::Vector3d(angle(random), angle(random), angle(random)),
                        square ? Eigen::Vector3d(0, 0, random() % 2 == 0 ? 1 : -1)
                               : Eigen::Vector3d(length(random), length(random), length(random) + 0.1)});
      if (i == 0 || random() % 2 == 0) continue;
      const auto at = static_cast<std::size_t>(i);
      leader[at] = static_cast<int>(random() % at);
      multiplier[at] = 0.4 * length(random);
      offset[at] = length(random);
    }
    std::string text = urdf_of(joints);
    for (std::size_t i = 0; i < leader.size(); ++i) {
      if (leader[i] < 0) continue;
      const std::size_t end = text.find("</joint>", text.find(fmt::format("<joint name=\"j{}\"", i + 1)));
      text.insert(end, fmt::format("<mimic joint=\"j{}\" multiplier=\"{:.17g}\" offset=\"{:.17g}\"/>", leader[i] + 1,
                                   multiplier[i], offset[i]));
    }
    const SerialArm read = arm_of(text);
    ASSERT_EQ(read.free_joints(), std::count(leader.begin(), leader.end(), -1));
    const auto again = machine::from_text(machine::to_toml(machine::AnyMachine(read)), "again.toml");
    ASSERT_TRUE(again) << to_string(again.error());
    const std::array both{read, std::get<SerialArm>(*again)};
    for (const SerialArm& arm : both) {
      JointVector q(arm.free_joints());
      for (double& value : q) value = angle(random);
      std::vector<double> all;
      Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
      for (std::size_t i = 0, next = 0; i < joints.size(); ++i) {
        all.push_back(leader[i] < 0 ? q[static_cast<Eigen::Index>(next++)]
                                    : multiplier[i] * all[static_cast<std::size_t>(leader[i])] + offset[i]);
        X = X * transform_of(joints[i], all.back());
      }
      X = X * Eigen::AngleAxisd(kPi, Eigen::Vector3d::UnitX());
      // Written and read again a figure is rounded to 1e-13 mm or deg; nearly parallel axes have tables of many metres.
      const double exact = &arm == &both.front() ? kExact : 1e-10;
      EXPECT_LT(difference(forward(arm, q), Pose{X.linear(), X.translation()}), exact) << trial;
      // Both Jacobians, of the chain and of its closure, against differences.
      const auto J = machine::forward_jacobian(arm, q).J;
      for (Eigen::Index k = 0; k < q.size(); ++k) {
        constexpr double kStep = 1e-6;
        JointVector more = q, less = q;
        more[k] += kStep;
        less[k] -= kStep;
        const Vec3 slope = (forward(arm, more).p - forward(arm, less).p) / (2 * kStep);
        EXPECT_LT((J.col(k).head<3>() - slope).norm(), 1e-7) << trial;
      }
    }
  }
}

TEST(Urdf, LimitsAndSpeedsOfAFollowerHoldForItsLeader) {
  std::vector<MadeJoint> joints(3, {"revolute", {0.3, 0, 0.1}, Eigen::Vector3d::Zero(), {0, 1, 0}});
  std::string text = urdf_of(joints);
  const std::size_t end = text.find("</joint>", text.find("<joint name=\"j3\""));
  text.insert(end, "<mimic joint=\"j2\" multiplier=\"-2\" offset=\"1\"/>");
  const SerialArm arm = arm_of(text);
  ASSERT_EQ(arm.free_joints(), 2);
  // -3 <= 1 - 2 q <= 3, |2 q'| <= 2
  EXPECT_NEAR(joint_range(arm, 1).min, -1, 1e-12);
  EXPECT_NEAR(joint_range(arm, 1).max, 2, 1e-12);
  EXPECT_NEAR(joint_speed_limit(arm, 1), 1, 1e-12);
  EXPECT_NEAR(joint_range(arm, 0).max, 3, 1e-12);
  EXPECT_EQ(arm.provenance.at("joints"), "1 j1, 2 j2, j3 follows j2");
  // A follower without limits gives none to its leader.
  const std::size_t type = text.find("revolute", text.find("<joint name=\"j3\""));
  const SerialArm endless = arm_of(text.replace(type, std::string("revolute").size(), "continuous"));
  EXPECT_NEAR(joint_range(endless, 1).min, -3, 1e-12);
  EXPECT_NEAR(joint_range(endless, 1).max, 3, 1e-12);
  EXPECT_NEAR(joint_speed_limit(endless, 1), 1, 1e-12);
}

TEST(Urdf, NearlyParallelAxesLoseNoDigits) {
  constexpr unsigned kSeed = 2;
  std::mt19937 random(kSeed);
  double worst = 0;
  for (const double tilt : {1e-14, 1e-13, 1e-12, 3e-10, 1e-9, 1e-7, 1e-5, 9e-4, 1.1e-3}) {
    for (const double offset : {0.0, 1e-9, 1e-6, 0.3}) {
      const std::vector<MadeJoint> joints{{"revolute", {0, 0, 0.2}, {0, 0, 0}, {0, 0, 1}},
                                          {"revolute", {offset, 0.2 * offset, 0.1}, {tilt, 0.3 * tilt, 0.4}, {0, 0, 1}},
                                          {"revolute", {0.5, offset, 0}, {kPi + tilt, 0, 0}, {0, 0, 1}},
                                          {"revolute", {0, 0.4, 0}, {1, 0, 0}, {0, 1, 0}}};
      const double off = off_product(joints, arm_of(urdf_of(joints)), random);
      EXPECT_LT(off, kExact) << "tilt " << tilt << ", offset " << offset << ", seed " << kSeed;
      worst = std::max(worst, off);
    }
  }
  fmt::print("nearly parallel: {:.2g}\n", worst);
}

class PublishedArm : public testing::TestWithParam<std::pair<const char*, const char*>> {};
INSTANTIATE_TEST_SUITE_P(Urdf, PublishedArm,
                         testing::Values(std::pair{"ur10e.urdf", "ur10e"}, std::pair{"kuka_kr210.urdf", "kuka-kr210"}),
                         [](const auto& arm) { return std::string(arm.param.first).substr(0, 4); });

TEST_P(PublishedArm, AgreesWithTheCatalogue) {
  const auto read = machine::load(kExamples + GetParam().first);
  ASSERT_TRUE(read.has_value()) << to_string(read.error());
  const machine::AnyMachine known = test::load(GetParam().second);
  std::mt19937 random(3);
  double worst = 0;
  for (int i = 0; i < 6; ++i) {
    const auto a = kinematics::joint_range(*read, i), b = kinematics::joint_range(known, i);
    EXPECT_NEAR(a.min, b.min, kExact);
    EXPECT_NEAR(a.max, b.max, kExact);
  }
  std::uniform_real_distribution<double> angle(-kPi, kPi);
  for (int k = 0; k < 1000; ++k) {
    const JointVector q = JointVector::NullaryExpr(6, [&] { return angle(random); });
    worst = std::max(worst, difference(forward(std::get<SerialArm>(*read), q), forward(std::get<SerialArm>(known), q)));
  }
  EXPECT_LT(worst, kExact);
  fmt::print("{}: {:.2g}\n", GetParam().first, worst);
}

TEST_P(PublishedArm, HasTheSameClosedInverse) {
  const auto read = machine::load(kExamples + GetParam().first);
  ASSERT_TRUE(read.has_value()) << to_string(read.error());
  const machine::AnyMachine known = test::load(GetParam().second);
  EXPECT_TRUE(has_closed_inverse(std::get<SerialArm>(*read)));
  std::mt19937 random(4);
  std::uniform_real_distribution<double> angle(-2, 2);
  for (int k = 0; k < 100; ++k) {
    const JointVector q = JointVector::NullaryExpr(6, [&] { return angle(random); });
    const Pose X = forward(std::get<SerialArm>(known), q);
    const auto a = kinematics::inverse(*read, X), b = kinematics::inverse(known, X);
    ASSERT_EQ(a.solutions.size(), b.solutions.size());
    for (std::size_t s = 0; s < a.solutions.size(); ++s) {
      EXPECT_EQ(kinematics::branch_name(*read, a.solutions[s].branch),
                kinematics::branch_name(known, b.solutions[s].branch));
      EXPECT_LT(difference(forward(std::get<SerialArm>(*read), a.solutions[s].joints), X), 1e-11);
    }
  }
}

TEST_P(PublishedArm, IsWrittenAsAMachineFileThatReadsBack) {
  const auto read = machine::load(kExamples + GetParam().first);
  ASSERT_TRUE(read.has_value()) << to_string(read.error());
  const std::string toml = machine::to_toml(*read);
  const auto again = machine::from_text(toml, "written.toml");
  ASSERT_TRUE(again.has_value()) << to_string(again.error());
  EXPECT_EQ(machine::to_toml(*again), toml);
  const JointVector q = JointVector::LinSpaced(6, -0.9, 1.1);
  EXPECT_LT(difference(forward(std::get<SerialArm>(*read), q), forward(std::get<SerialArm>(*again), q)), kExact);
  EXPECT_TRUE(has_closed_inverse(std::get<SerialArm>(*again)));
}

TEST(Urdf, KeysOfTheMachineFileMayBeSet) {
  const auto plain = machine::load(kExamples + "kuka_kr210.urdf");
  const auto longer = machine::load(kExamples + "kuka_kr210.urdf", {{"tool.z_mm", "200"}, {"limits[1].max_deg", "90"}});
  ASSERT_TRUE(plain.has_value()) << to_string(plain.error());
  ASSERT_TRUE(longer.has_value()) << to_string(longer.error());
  EXPECT_NEAR(kinematics::joint_range(*longer, 0).max, kPi / 2, 1e-15);
  const JointVector q = JointVector::LinSpaced(6, -0.9, 1.1);
  const Pose X = forward(std::get<SerialArm>(*plain), q), Y = forward(std::get<SerialArm>(*longer), q);
  EXPECT_LT((Y.p - (X.p - 0.2 * X.R.col(2))).norm(), kExact);  // z_T points to the flange
  const auto unknown = machine::load(kExamples + "kuka_kr210.urdf", {{"tool.zz_mm", "200"}});
  ASSERT_FALSE(unknown.has_value());
  EXPECT_EQ(unknown.error().id, "CF103");
}

// A robot on a pedestal: `base` is where it stands, and its table that of the robot alone, as its controller takes it.
TEST(Urdf, FixedJointsBeforeTheFirstMovingOneAreTheBase) {
  std::string text = text_of(kExamples + "kuka_kr210.urdf");
  const SerialArm alone = arm_of(text);
  const std::size_t first = text.find("<link name=\"");
  const std::size_t name = first + 12;
  const std::string base = text.substr(name, text.find('"', name) - name);
  text.insert(text.rfind("</robot>"),
              fmt::format("<link name=\"floor\"/><joint name=\"stands\" type=\"fixed\"><parent link=\"floor\"/><child "
                          "link=\"{}\"/><origin xyz=\"0.1 -0.2 0.3\" rpy=\"0 0 1.5707963267948966\"/></joint>\n",
                          base));
  const SerialArm stands = arm_of(text);
  ASSERT_EQ(stands.dh.size(), alone.dh.size());
  for (std::size_t i = 0; i < alone.dh.size(); ++i) {
    EXPECT_NEAR(stands.dh[i].a, alone.dh[i].a, kExact) << i;
    EXPECT_NEAR(stands.dh[i].alpha, alone.dh[i].alpha, kExact) << i;
    EXPECT_NEAR(stands.dh[i].d, alone.dh[i].d, kExact) << i;
    EXPECT_NEAR(stands.dh[i].theta_offset, alone.dh[i].theta_offset, kExact) << i;
  }
  const Pose floor{rotation_z(kPi / 2), Vec3(0.1, -0.2, 0.3)};
  EXPECT_LT(difference(stands.X_MB, floor * alone.X_MB), kExact);
}

/// The UR10e with its angles written in another way.
std::string ur_with(const std::string& quarter, const std::string& half) {
  std::string text = text_of(kExamples + "ur10e.urdf");
  const auto replace = [&](const std::string& from, const std::string& to) {
    for (std::size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size())) {
      text.replace(at, from.size(), to);
    }
  };
  replace("1.570796327", quarter);
  replace("3.141592654", half);
  return text;
}

TEST(Urdf, RoundedAnglesAreMeantAsMultiplesOf15Deg) {
  for (const char* quarter : {"1.5708", "1.57080", "1.57079", "1.570796", "1.5707963267948966", "+1.5707963"}) {
    const SerialArm arm = arm_of(ur_with(quarter, "3.14159"));
    EXPECT_TRUE(has_closed_inverse(arm)) << quarter;
    EXPECT_EQ(arm.dh.size(), 6U) << quarter;
  }
  EXPECT_THAT(arm_of(ur_with("1.5708", "3.1416")).provenance.at("angles"),
              HasSubstr("shoulder_lift_joint 1.5708 = 90 deg"));
  EXPECT_FALSE(arm_of(ur_with("1.5707963267948966", "3.141592653589793")).provenance.contains("angles"));
  // Two decimals, or digits that a calibration gave, are taken as they stand.
  for (const char* quarter : {"1.57", "1.570", "1.5706", "1.57085", "1.5707961"}) {
    const SerialArm arm = arm_of(ur_with(quarter, "3.141592654"));
    EXPECT_FALSE(has_closed_inverse(arm)) << quarter;
  }
}

/// A tree: an arm of two joints, and what the test hangs on its last link.
std::string tree(const std::string& more, const std::string& last = "hand") {
  return fmt::format(R"(<robot name="t">
  <link name="world"/><link name="base"/><link name="arm"/><link name="{0}"/>
  <joint name="stand" type="fixed"><parent link="world"/><child link="base"/><origin xyz="0 0 1"/></joint>
  <joint name="j1" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint>
  <joint name="j2" type="continuous"><parent link="arm"/><child link="{0}"/><origin xyz="0.5 0 0"/><axis xyz="0 1 0"/></joint>
{1}
</robot>)",
                     last, more);
}
std::string fixed(const std::string& parent, const std::string& child, const std::string& xyz = "0 0 0.1") {
  return fmt::format(R"(<link name="{1}"/><joint name="to_{1}" type="fixed"><parent link="{0}"/><child link="{1}"/>)"
                     R"(<origin xyz="{2}"/></joint>)",
                     parent, child, xyz);
}
std::string finger(const std::string& child) {
  return fmt::format(
      R"(<link name="{0}"/><joint name="to_{0}" type="prismatic"><parent link="hand"/><child link="{0}"/>)"
      R"(<axis xyz="0 1 0"/><limit lower="0" upper="0.03" effort="1" velocity="1"/></joint>)",
      child);
}

TEST(Urdf, TheTipIsNamedOrFollowsFromARule) {
  const auto tip = [](const std::string& text, const std::string& name = "test.urdf") {
    return arm_of(text, name).description;
  };
  EXPECT_EQ(tip(tree("")), "URDF, world to hand");
  EXPECT_EQ(tip(tree("", "tool0")), "URDF, world to tool0");
  EXPECT_EQ(tip(tree(fixed("hand", "flange") + fixed("hand", "tool0"))), "URDF, world to tool0");
  EXPECT_EQ(tip(tree(fixed("hand", "flange") + fixed("hand", "left_tool0"))), "URDF, world to left_tool0");
  EXPECT_EQ(tip(tree(fixed("hand", "tool0") + finger("one") + finger("two"))), "URDF, world to tool0");
  EXPECT_EQ(tip(tree(fixed("base", "plate"))), "URDF, world to hand");  // no joint moves the plate
  const std::string two = tree(finger("one") + finger("two"));
  EXPECT_EQ(tip(two, "test.urdf#hand"), "URDF, world to hand");
  EXPECT_EQ(tip(two, "test.urdf#two"), "URDF, world to two");
  EXPECT_EQ(tip(two, "test.urdf#base:two"), "URDF, base to two");
  EXPECT_EQ(arm_of(two, "test.urdf#two").free_joints(), 3);
  const Pose from_world = forward(arm_of(two, "test.urdf#hand"), JointVector::Zero(2));
  const Pose from_base = forward(arm_of(two, "test.urdf#base:hand"), JointVector::Zero(2));
  EXPECT_NEAR(from_world.p.z() - from_base.p.z(), 1, kExact);

  Error e = error_of(two);
  EXPECT_EQ(e.id, "MA186");
  EXPECT_THAT(e.message, HasSubstr("the tip can be hand, one, two"));
  EXPECT_THAT(e.hint, HasSubstr("test.urdf#hand"));
  e = error_of(tree(fixed("hand", "left_tool0") + fixed("hand", "right_tool0")));
  EXPECT_THAT(e.message, HasSubstr("left_tool0, right_tool0"));
  const std::string long_name = std::string(80, 'a') + "_flange";
  e = error_of(tree(finger("one") + finger(long_name)));
  EXPECT_THAT(e.message, HasSubstr(long_name)) << "names that are to be written are whole";
  e = error_of(two, "test.urdf#hnad");
  EXPECT_EQ(e.id, "MA186");
  EXPECT_THAT(e.hint, HasSubstr("did you mean hand?"));
  EXPECT_EQ(error_of(two, "test.urdf#two:one").id, "MA186");
  EXPECT_EQ(error_of(two, "test.urdf#world:base").id, "MA191");
}

/// The arm of `tree` with a text replaced.
std::string with(const std::string& from, const std::string& to) {
  std::string text = tree("");
  const std::size_t at = text.find(from);
  if (at == std::string::npos) throw std::runtime_error(from);
  return text.replace(at, from.size(), to);
}

TEST(Urdf, WhatIsRefusedIsNamedWithItsPlace) {
  struct Case {
    std::string text;
    const char* id;
    int line;
    const char* says;
  };
  const std::string j2 = R"(<joint name="j2" type="continuous">)", axis = R"(<axis xyz="0 1 0"/>)",
                    origin = R"(<origin xyz="0.5 0 0"/>)";
  // Joint j2 with another part of it.
  const auto type = [&](const std::string& t) { return with(j2, "<joint name=\"j2\" type=\"" + t + "\">"); };
  const auto along = [&](const std::string& xyz) { return with(axis, "<axis xyz=\"" + xyz + "\"/>"); };
  const auto turned = [&](const std::string& rpy) {
    return with(origin, "<origin xyz=\"0.5 0 0\" rpy=\"" + rpy + "\"/>");
  };
  const auto limited = [&](const std::string& ends) {
    return with(j2, "<joint name=\"j2\" type=\"revolute\"><limit " + ends + " effort=\"1\" velocity=\"1\"/>");
  };
  const auto joined = [&](const std::string& which, const std::string& from, const std::string& to) {
    return with("<" + which + " link=\"" + from + "\"/>", "<" + which + " link=\"" + to + "\"/>");
  };
  const auto beside_arm = [&](const std::string& more) {
    return with(R"(<link name="arm"/>)", R"(<link name="arm"/>)" + more);
  };
  const std::vector<Case> cases{
      {"", "MA180", 1, "no element"},
      {"robot", "MA180", 1, "text before"},
      {with("</robot>", ""), "MA180", 1, "<robot> has no end"},
      {with("</robot>", "</robt>"), "MA180", 7, "</robt>, but <robot> of line 1 is open"},
      {with("name=\"j1\"", "name=j1"), "MA180", 4, "quotes"},
      {with("name=\"j1\"", "name=\"j1\" name=\"j2\""), "MA180", 4, "twice"},
      {with("name=\"j1\"", "name=\"j1"), "MA180", 4, "<joint> has no >"},
      {tree("") + "<robot/>", "MA180", 7, "second outermost"},
      {"<!DOCTYPE r [<!ENTITY a \"aaaa\">]>\n" + tree(""), "MA181", 1, "document type"},
      {with("<link name=\"arm\"/>", "<xacro:arm name=\"x\"/>"), "MA182", 2, "xacro"},
      {with("0.5 0 0", "${length} 0 0"), "MA182", 5, "xacro"},
      {"<sdf version=\"1.7\"><model name=\"a\"/></sdf>", "MA183", 1, "<sdf>"},
      {"<robot name=\"a\"/>", "MA183", 1, "no link"},
      {with(j2, "<joint type=\"continuous\">"), "MA183", 5, "name"},
      {with(j2, "<joint name=\"j2\">"), "MA183", 5, "type"},
      {with("name=\"j2\"", "name=\"j1\""), "MA183", 5, "second joint j1"},
      {beside_arm("<link name=\"arm\"/>"), "MA183", 2, "second link arm"},
      {with("<child link=\"hand\"/>", ""), "MA183", 5, "no <child>"},
      {joined("child", "hand", "hnd"), "MA184", 5, "there is no link hnd"},
      {joined("parent", "arm", "am"), "MA184", 5, "there is no link am"},
      {joined("child", "hand", "arm"), "MA185", 5, "moved by two joints, j1 and j2"},
      {joined("parent", "base", "hand"), "MA185", 4, "loop"},
      {beside_arm("<link name=\"crate\"/>"), "MA185", 2, "2 links have no parent: world, crate"},
      {type("floating"), "MA187", 5, "floating"},
      {type("planar"), "MA187", 5, "planar"},
      {type("revolut"), "MA187", 5, "revolut"},
      {with(axis, axis + "<mimic joint=\"j9\" multiplier=\"2\"/>"), "MA188", 5,
       "joint j2 follows joint j9 (mimic), which"},
      {with(axis, axis + "<mimic multiplier=\"2\"/>"), "MA188", 5, "names no joint"},
      {with(axis, axis + "<mimic joint=\"j1\" multiplier=\"2 deg\"/>"), "MA188", 5, "is no number"},
      {with(j2,
            "<joint name=\"j2\" type=\"revolute\"><limit lower=\"-1\" upper=\"1\" effort=\"1\" velocity=\"1\"/>"
            "<mimic joint=\"j1\" offset=\"90\"/>"),
       "MA188", 5, "no angle"},
      {type("revolute"), "MA189", 5, "limit"},
      {along("0 nan 0"), "MA189", 5, "j2"},
      {along("0 1"), "MA189", 5, "j2"},
      {along("0 1e999 0"), "MA189", 5, "j2"},
      {along("0 &lt; 0"), "MA189", 5, "characters"},
      {turned("0 0 1 2"), "MA189", 5, "j2"},
      {turned("0 0 inf"), "MA189", 5, "j2"},
      {along("0 0 0"), "MA190", 5, "no direction"},
      {along("0 1e30 0"), "MA190", 5, "no direction"},
      {with("0.5 0 0", "5e30 0 0"), "MA190", 5, "farther than 1e+06 m"},
      {turned("0 0 1e20"), "MA190", 5, "rad"},
      {limited("lower=\"1\" upper=\"-1\""), "MA190", 5, "not below"},
      {limited(""), "MA190", 5, "not below"},
      {limited("lower=\"-1e9\" upper=\"1\""), "MA190", 5, "limits -1e+09 .. 1 beyond"},
      {"<robot name=\"a\"><link name=\"a\"/></robot>", "MA191", 1, "no joint"},
  };
  testing::internal::CaptureStderr();
  for (const Case& c : cases) {
    const Error e = error_of(c.text);
    EXPECT_EQ(e.id, c.id) << to_string(e) << "\n" << c.text;
    EXPECT_EQ(e.place.line, c.line) << to_string(e) << "\n" << c.text;
    EXPECT_EQ(e.place.file, "test.urdf");
    EXPECT_THAT(e.message, HasSubstr(c.says));
  }
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");  // urdfdom speaks through errors alone
}

TEST(Urdf, HostileTextsCostLittle) {
  const auto repeated = [](const std::string& text, int times) {
    std::string out;
    for (int i = 0; i < times; ++i) out += text;
    return out;
  };
  EXPECT_EQ(error_of(repeated("<a>", 1'000'000)).id, "MA181");
  EXPECT_EQ(error_of(with("<axis", repeated("<a>", 1'000'000) + "<axis")).id, "MA181");
  EXPECT_EQ(error_of(with("<axis", repeated("<a/>", 300'000) + "<axis")).id, "MA181");
  EXPECT_EQ(error_of(with("<axis", "<axis " + repeated("a", 1'000'000))).id, "MA180");
  EXPECT_EQ(error_of(with("</robot>", std::string(17U << 20U, ' '))).id, "MA181");
  EXPECT_EQ(error_of(with("</robot>", std::string(1, '\0'))).id, "MA180");
  EXPECT_EQ(error_of("<robot" + repeated(" a=\"", 100'000)).id, "MA180");
  std::string many = "<robot name=\"a\"><link name=\"l0\"/>";
  for (int i = 1; i <= 20; ++i) {
    many += fmt::format(
        "<link name=\"l{0}\"/><joint name=\"j{0}\" type=\"continuous\"><parent link=\"l{1}\"/><child "
        "link=\"l{0}\"/></joint>",
        i, i - 1);
  }
  EXPECT_EQ(error_of(many + "</robot>").id, "MA191");
}

TEST(Urdf, WhatIsNotReadDoesNotMatter) {
  const std::string more =
      R"(<transmission name="x"><type>a</type></transmission><gazebo reference="arm"><![CDATA[<a>]]></gazebo>
    <?note?><!-- <joint> --><material name="m"/>)";
  const SerialArm plain = arm_of(tree("")), other = arm_of("\xEF\xBB\xBF<?xml version='1.0'?>\n" + tree(more));
  const JointVector q = JointVector::LinSpaced(2, 0.3, 0.8);
  EXPECT_EQ(difference(forward(plain, q), forward(other, q)), 0);
  const SerialArm ur = arm_of(text_of(kExamples + "ur10e.urdf"));
  EXPECT_THAT(ur.provenance.at("bodies"), HasSubstr("6 visual and collision bodies"));
  EXPECT_NEAR(units::to_deg(machine::joint_speed_limit(ur, 0)), 120, 0.01);
  EXPECT_NEAR(units::to_deg(machine::joint_speed_limit(ur, 5)), 180, 0.01);
  const auto again = machine::from_text(machine::to_toml(ur), "again.toml");
  ASSERT_TRUE(again);
  EXPECT_NEAR(machine::joint_speed_limit(std::get<SerialArm>(*again), 0), machine::joint_speed_limit(ur, 0), 1e-12);
  EXPECT_THAT(ur.provenance.at("joints"), HasSubstr("6 wrist_3_joint"));
}

TEST(Urdf, AStageMayBeAnUrdfFile) {
  const std::filesystem::path folder = std::filesystem::path(testing::TempDir()) / "urdf_stage";
  std::filesystem::create_directories(folder);
  std::ofstream(folder / "wrist.urdf") << tree(finger("one") + finger("two"));
  std::ofstream(folder / "stages.toml") << R"(
family = "stages"
task = ["x", "y", "z", "A", "B"]
[[stage]]
machine = "tricept"
[[stage]]
machine = "wrist.urdf#hand"
)";
  const auto m = machine::load((folder / "stages.toml").string());
  ASSERT_TRUE(m.has_value()) << to_string(m.error());
  EXPECT_EQ(kinematics::joint_count(*m), 5);
}

TEST(Urdf, AnyBytesGiveAnErrorOrAnArm) {
  constexpr unsigned kSeed = 5;
  std::mt19937 random(kSeed);
  const std::vector<std::string> seeds{text_of(kExamples + "ur10e.urdf"), tree(finger("one") + fixed("hand", "tool0"))};
  const std::vector<std::string> words{"<",        ">",         "/>",      "\"",    "=",     "&amp;",
                                       "nan",      "1e308",     "-1e-308", "tool0", "fixed", "<!--",
                                       "-->",      "<![CDATA[", "]]>",     "<?",    "?>",    "<robot>",
                                       "</robot>", "link",      "joint",   "world", "${a}",  std::string("\0", 1),
                                       "\xEF\xBF", "mimic",     "0 0 0",   "rpy"};
  const auto below = [&](std::size_t n) { return std::uniform_int_distribution<std::size_t>(0, n - 1)(random); };
  int arms = 0, errors = 0;
  std::map<std::string, int> ids;
  for (int trial = 0; trial < 6000; ++trial) {
    std::string text = seeds[below(seeds.size())];
    for (std::size_t changes = 1 + below(4); changes > 0 && !text.empty(); --changes) {
      const std::size_t at = below(text.size()), length = std::min(text.size() - at, std::size_t{1} + below(20));
      switch (below(5)) {
        case 0:
          text[at] = static_cast<char>(below(256));
          break;
        case 1:
          text.erase(at, length);
          break;
        case 2:
          text.insert(below(text.size()), text.substr(at, length));
          break;
        case 3:
          text.insert(at, words[below(words.size())]);
          break;
        default: {  // a number of another size
          const std::size_t digit = text.find_first_of("0123456789", at);
          if (digit != std::string::npos) text.replace(digit, 1, words[6 + below(3)]);
        }
      }
    }
    const auto m = machine::from_text(text, "fuzz.urdf");
    if (!m) {
      ++errors;
      ++ids[m.error().id];
      ASSERT_FALSE(m.error().message.empty()) << text;
      ASSERT_EQ(m.error().place.file, "fuzz.urdf") << to_string(m.error()) << text;
      continue;
    }
    ++arms;
    const SerialArm& arm = std::get<SerialArm>(*m);
    ASSERT_TRUE(forward(arm, JointVector::Zero(arm.free_joints())).p.allFinite()) << text;
    const auto again = machine::from_text(machine::to_toml(*m), "again.toml");
    ASSERT_TRUE(again.has_value()) << to_string(again.error()) << text;
  }
  std::string seen;
  for (const auto& [id, count] : ids) seen += fmt::format(" {} {}", id, count);
  fmt::print("seed {}: {} arms, {} errors:{}\n", kSeed, arms, errors, seen);
  EXPECT_GT(arms, 500);
  EXPECT_GT(ids.size(), 6U);
}

}  // namespace
}  // namespace polypod
