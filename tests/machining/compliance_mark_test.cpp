// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the header of a corrected program says of the compliance, and the posture in which a job cuts.
#include "polypod/machining/compliance_mark.hpp"

#include <gmock/gmock.h>

#include "machining/examples.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/posture.hpp"
#include "polypod/machine/any_machine.hpp"
#include "polypod/machining/tilted.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod::machining {
namespace {

constexpr double kCompliances[] = {2e-7, 3.5e-7, 4e-7, 1.2e-6, 1.5e-6, 2.5e-6};  // rad/Nm, invented

Job robot() {
  Job job;
  const machine::AnyMachine arm = testing::unwrap(machine::load("kuka-kr210", {{"tool.z_mm", "250"}}));
  job.machine = testing::unwrap(statics::with_compliances(arm, {std::begin(kCompliances), std::end(kCompliances)}));
  job.X_MW = Pose{Mat3::Identity(), Vec3(1.7, 0.2, 0.6)};
  return job;
}

gcode::Move move_from(const Vec3& start) {
  gcode::Move move;
  move.start = start;
  return move;
}

TEST(ComplianceMark, IsThatOfTheJointsInTheJobsPosture) {
  Job job = robot();
  const Vec3 p(-0.13, -0.119, -0.001);
  const Pose X_MT{tool_orientation(job, Vec3::Zero()), job.X_MW * p};
  const kinematics::InverseResult inverse = kinematics::inverse(job.machine, X_MT);
  const std::vector<std::string> postures = kinematics::postures_of(job.machine, inverse);
  ASSERT_GE(postures.size(), 4u);
  std::vector<Vec3> seen;
  for (const std::string& posture : postures) {
    job.posture = posture;
    const kinematics::Solution* s = kinematics::reachable_in(job.machine, inverse, posture);
    ASSERT_NE(s, nullptr) << posture;
    EXPECT_EQ(kinematics::posture_of(job.machine, s->joints), posture);
    const Mat3 C = statics::compliance_at_joints(job.machine, s->joints).linear();
    const auto mark = compliance_mark(job, move_from(p));
    ASSERT_TRUE(mark);
    EXPECT_LT((mark->deflection - 100 * C.diagonal()).norm(), 1e-12) << posture;
    // What predict takes.
    statics::Probe probe(job.machine, X_MT.R, posture);
    Mat3 along;
    ASSERT_TRUE(probe.at(X_MT.p, along)) << posture;
    EXPECT_LT((along - C).norm(), 1e-12) << posture;
    EXPECT_EQ(posture_at_start(job, move_from(p)), posture);
    seen.push_back(mark->deflection);
  }
  EXPECT_GT((seen.front() - seen.back()).norm(), 10e-6);  // front and back differ
}

TEST(ComplianceMark, ReadsWhatItWrites) {
  const ComplianceMark mark{{0.0123456, -1.3, 0}, {0, units::from_deg(15.25), units::from_deg(-90)}, {1e-5, 2e-5, 0}};
  EXPECT_EQ(mark.in_words(),
            "at X12.346 Y-1300 Z0 A0 B15.25 C-90 100 N along X, Y, Z deflect the tool by 10, 20, 0 um");
  const auto again = ComplianceMark::from("(Polypod: " + mark.in_words() + ")");
  ASSERT_TRUE(again);
  EXPECT_LT((again->p - mark.p).norm(), 1e-6);
  EXPECT_LT((again->axes - mark.axes).norm(), 1e-12);
  EXPECT_LT((again->deflection - mark.deflection).norm(), 1e-12);
  EXPECT_TRUE(again->same({mark.deflection, {}}));
  EXPECT_TRUE(again->same({1.005 * mark.deflection, {}}));
  EXPECT_FALSE(again->same({1.02 * mark.deflection, {}}));
  for (const char* text : {"", "at X1", "at X1 Y2 Z3 A0 B0 C0",
                           "at Xnan Y0 Z0 A0 B0 C0 100 N along X, Y, Z deflect the "
                           "tool by 1, 2, 3 um"})
    EXPECT_FALSE(ComplianceMark::from(text)) << text;
}

/// Of a pose that leaves a joint free the joints belong to the mark, to four digits.
TEST(ComplianceMark, KeepsTheJointsOfASample) {
  Job job = robot();
  const Vec3 p(-0.13, -0.119, -0.001);
  const Pose X_MT{tool_orientation(job, Vec3::Zero()), job.X_MW * p};
  const kinematics::InverseResult inverse = kinematics::inverse(job.machine, X_MT);
  Sample sample;
  sample.command = p;
  std::vector<Vec3> seen;
  for (const kinematics::Solution& s : inverse.solutions) {
    if (s.violations != 0) continue;
    sample.joint_count = 6;
    for (int i = 0; i < 6; ++i) sample.joints[static_cast<std::size_t>(i)] = static_cast<float>(s.joints[i]);
    const auto mark = compliance_mark(job, sample);
    ASSERT_TRUE(mark);
    const Mat3 C = statics::compliance_at_joints(job.machine, s.joints).linear();
    EXPECT_LT((mark->deflection - 100 * C.diagonal()).norm(), 1e-9);
    const machine::JointVector again =
        ComplianceMark::joints_from("(Polypod: " + mark->joints_in_words(job.machine) + ")", job.machine);
    ASSERT_EQ(again.size(), 6);
    EXPECT_LT((again - s.joints).cwiseAbs().maxCoeff(), units::from_deg(1e-4));
    seen.push_back(mark->deflection);
  }
  ASSERT_GE(seen.size(), 2u);
  EXPECT_GT((seen.front() - seen.back()).norm(), 10e-6);
  for (const char* text :
       {"", "the joints there are 1, 2, 3 mm or deg", "the joints there are 1, 2, 3, 4, 5, x mm or deg",
        "the joints there are 1, 2, 3, 4, 5, 6, 7 mm or deg"})
    EXPECT_EQ(ComplianceMark::joints_from(text, job.machine).size(), 0) << text;
}

/// A posture that the arm does not have there is refused, and the others are named.
TEST(ComplianceMark, APostureThatIsNotThereIsNone) {
  Job job = robot();
  job.posture = "front elbow-down";  // beyond the range of joint 2 there
  EXPECT_FALSE(compliance_mark(job, move_from(Vec3(-0.13, -0.119, -0.001))));
  statics::Probe probe(job.machine, tool_orientation(job, Vec3::Zero()), job.posture);
  Mat3 C;
  EXPECT_FALSE(probe.at(job.X_MW.p, C));
  EXPECT_THAT(probe.why(),
              ::testing::HasSubstr("not within the limits in the posture front elbow-down; in front elbow-up"));
  const Job none = [] {
    Job made = robot();
    made.machine = testing::unwrap(machine::load("kuka-kr210"));
    return made;
  }();
  EXPECT_FALSE(compliance_mark(none, move_from(Vec3::Zero())));  // without compliances
}

/// An arm with five joints keeps the posture at every point: the first within the limits is asked only without one.
TEST(ComplianceMark, AClosedInverseOfPointAndAxisKeepsThePosture) {
  const machine::AnyMachine arm = testing::unwrap(machine::load("lola50"));
  const Vec3 p(0, -1.3, 0);
  const Mat3 R = Mat3::Identity();
  const kinematics::InverseResult inverse = kinematics::inverse(arm, Pose{R, p});
  const std::vector<std::string> postures = kinematics::postures_of(arm, inverse);
  ASSERT_FALSE(postures.empty());
  Mat3 C, first;
  ASSERT_TRUE(statics::Probe(arm, R).at(p, first));
  for (const kinematics::Solution& s : inverse.solutions) {
    const std::string name = kinematics::branch_name(arm, s.branch);
    statics::Probe probe(arm, R, name);
    ASSERT_EQ(probe.at(p, C), s.violations == 0) << name;
    if (s.violations == 0) {
      EXPECT_LT((C - statics::compliance_at_joints(arm, s.joints).linear()).norm(), 1e-14) << name;
    }
    if (name == postures.front()) {
      EXPECT_EQ(C, first);
    }
  }
}

// Each posture of an arm by its name, those beyond the limits too.
TEST(Posture, AllOfAMachine) {
  const std::vector<std::string> of_arm = kinematics::all_postures(*machine::load("lola50", {}));
  EXPECT_EQ(of_arm.size(), 8U);
  for (const char* name : {"front elbow-up", "front elbow-down", "back elbow-up"})
    EXPECT_NE(std::find_if(of_arm.begin(), of_arm.end(), [&](const std::string& s) { return s.starts_with(name); }),
              of_arm.end())
        << name;
}

}  // namespace
}  // namespace polypod::machining
