// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Machines in series: against one arm cut in two, a Tricept's closed form, and what must hold for every machine.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <random>

#include "machines.hpp"
#include "paths.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/families.hpp"
#include "polypod/kinematics/joint_speed.hpp"
#include "polypod/kinematics/parts.hpp"

namespace polypod {
namespace {

using kinematics::JointVector;
using machine::AnyMachine;

constexpr double kSame = 1e-9;  // m and rad: rounding of files and of the search

AnyMachine read(const std::string& text) {
  const auto m = machine::from_text(text, "test.toml");
  if (!m) throw std::runtime_error(to_string(m.error()));
  return *m;
}
std::string id_of(const std::string& text) {
  const auto m = machine::from_text(text, "test.toml");
  return m ? "none" : m.error().id;
}

/// The LOLA 50 of SLAV Table 3.1's kind, whole and cut behind its third row.
constexpr const char* kRows[6] = {
    "{ a_mm = 300, alpha_deg = 90, d_mm = 1000 }",
    "{ a_mm = 1200, theta_offset_deg = 90 }",
    "{ alpha_deg = 90, theta_offset_deg = 90 }",
    "{ alpha_deg = -90, d_mm = 1400 }",
    "{ alpha_deg = 90 }",
    "{ d_mm = 200 }",
};
std::string rows(int first, int end) {
  std::string out = "dh = [\n";
  for (int i = first; i < end; ++i) out += fmt::format("  {},\n", kRows[i]);
  out += "]\nlimits = [\n";
  for (int i = first; i < end; ++i) out += "  { min_deg = -170, max_deg = 170 },\n";
  return out + "]\n";
}
AnyMachine whole_arm() {
  return read("family = \"serial\"\ntask = \"pose\"\n" + rows(0, 6) + "tool = { x_mm = 30, z_mm = 150, b_deg = 20 }\n");
}
AnyMachine cut_arm() {
  return read(
      "family = \"stages\"\ntask = \"pose\"\n[[stage]]\nhome = [10, -20, 30]\n[stage.machine]\nfamily = \"serial\"\n" +
      rows(0, 3) + "[[stage]]\nhome = [5, 40, -10]\n[stage.machine]\nfamily = \"serial\"\n" + rows(3, 6) +
      "tool = { x_mm = 30, z_mm = 150, b_deg = 20 }\n");
}

TEST(Stages, AnArmCutInTwoIsTheArm) {
  const AnyMachine whole = whole_arm(), cut = cut_arm();
  ASSERT_EQ(kinematics::joint_count(cut), 6);
  std::mt19937 random(7);
  std::uniform_real_distribution<double> unit(-1, 1);
  for (int k = 0; k < 25; ++k) {
    SCOPED_TRACE(k);
    const JointVector q = JointVector::NullaryExpr(6, [&] { return 2.0 * unit(random); });
    const Pose X = kinematics::forward(whole, q).poses.at(0), Y = kinematics::forward(cut, q).poses.at(0);
    EXPECT_LT((X.p - Y.p).norm() + (X.R - Y.R).norm(), 1e-13);
    EXPECT_LT((kinematics::jacobian(whole, X, q) - kinematics::jacobian(cut, Y, q)).norm(), 1e-12);
    // Every solution of the closed form leads to the pose in the cut arm, and what the search finds is among them.
    const auto closed = kinematics::inverse(whole, X), found = kinematics::inverse(cut, X);
    ASSERT_FALSE(closed.solutions.empty());
    ASSERT_FALSE(found.solutions.empty());
    for (const kinematics::Solution& s : found.solutions) {
      const Pose back = kinematics::forward(whole, s.joints).poses.at(0);
      EXPECT_LT((back.p - X.p).norm() + (back.R - X.R).norm(), kSame);
      EXPECT_TRUE(std::any_of(closed.solutions.begin(), closed.solutions.end(), [&](const kinematics::Solution& c) {
        JointVector d = c.joints - s.joints;
        for (double& x : d) x = std::remainder(x, 2 * std::numbers::pi);
        return d.cwiseAbs().maxCoeff() < 1e-6;
      })) << s.branch;
    }
    // The way of a program: from the last joints to the same posture.
    const auto near = kinematics::inverse_near(cut, X, q + JointVector::Constant(6, 0.02));
    ASSERT_FALSE(near.solutions.empty());
    EXPECT_LT((near.solutions[0].joints - q).cwiseAbs().maxCoeff(), 1e-7);
  }
}

/// The tripod's tube points from the joint at the origin to the platform, the platform's y axis is square to x of the
/// base; the wrist turns about the tube and then across it.
TEST(Stages, ATriceptWithItsWristMeetsItsClosedForm) {
  const AnyMachine m = test::load("tricept-wrist");
  const AnyMachine tripod = test::load("tricept");
  const Vec3 p(0.12, -0.08, 1.15);  // of the tripod's own tip
  const Vec3 z = p.normalized(), y = z.cross(Vec3::UnitX()).normalized();
  Mat3 R;
  R << y.cross(z), y, z;
  const Pose carrier{R, p};
  ASSERT_LT((kinematics::settled(tripod, Pose{Mat3::Identity(), p}).value().R - R).norm(), 1e-10);
  for (const auto& [turn, swivel] : {std::pair{0.3, 0.5}, std::pair{-1.1, 0.8}, std::pair{2.0, -0.4}}) {
    SCOPED_TRACE(turn);
    // d = 100 along the tube after the turn; across it the swivel; 250 to the tip.
    const Pose wrist = Pose{rotation_z(turn) * rotation_x(std::numbers::pi / 2), {0, 0, 0.1}} *
                       Pose{rotation_z(swivel) * rotation_x(-std::numbers::pi / 2), Vec3::Zero()} *
                       Pose{Mat3::Identity(), {0, 0, 0.25}};
    const Pose hung{rotation_x(std::numbers::pi), {0, 0, 1.9}}, flipped{rotation_x(std::numbers::pi), Vec3::Zero()};
    const Pose X = hung * carrier * wrist * flipped;
    const auto solved = kinematics::inverse(m, X);
    ASSERT_FALSE(solved.solutions.empty());
    const auto struts = kinematics::inverse(tripod, carrier).solutions.at(0).joints;
    bool found = false;
    for (const kinematics::Solution& s : solved.solutions) {
      const Pose back = kinematics::settled(m, X, s.joints);
      EXPECT_LT((back.p - X.p).norm() + angle_between(back.R.col(2), X.R.col(2)), kSame) << s.branch;
      if ((s.joints.head(3) - struts).norm() > 1e-8 || std::abs(s.joints[3] - turn) > 1e-8) continue;
      EXPECT_NEAR(s.joints[4], swivel, 1e-8);
      EXPECT_LT((back.R - X.R).norm(), kSame);
      found = true;
    }
    EXPECT_TRUE(found);
    // The other posture of the wrist: half a turn, and the swivel to the other side.
    EXPECT_GE(solved.solutions.size(), 2U);
  }
}

/// A target behind the carrier's home, which the struts reach beyond their limits in another assembly mode: the pose of
/// each solution is where the tool was asked to be all the same, and reaches() says what the limits do.
/// A Tricept with its wrist in closed form, and one whose tool axis misses the wrist's centre by 0.1 um: by search.
TEST(Stages, AWristOnAModuleMeetsTheSearch) {
  const AnyMachine closed = test::load("tricept-wrist");
  auto text = machine::to_toml(closed);
  const std::size_t at = text.find("a_mm = 0,", text.find("serial"));
  ASSERT_NE(at, std::string::npos) << text;
  text.replace(at, 9, "a_mm = 0.0001,");
  const AnyMachine searched = read(text);
  std::mt19937 random(3);
  std::uniform_real_distribution<double> unit(-1, 1);
  int judged = 0;
  for (int k = 0; k < 60; ++k) {
    SCOPED_TRACE(k);
    JointVector q(5);
    for (int j = 0; j < 3; ++j) q[j] = 0.95 + 0.15 * unit(random);
    q[3] = 3 * unit(random);
    q[4] = 2 * unit(random);
    const auto poses = kinematics::forward(closed, q).poses;
    if (poses.empty()) continue;
    const auto found = kinematics::inverse(closed, poses[0]), others = kinematics::inverse(searched, poses[0]);
    ASSERT_EQ(found.solutions.size(), 2u);
    const auto is_among = [](const JointVector& joints, const kinematics::InverseResult& in, double same) {
      return std::any_of(in.solutions.begin(), in.solutions.end(), [&](const kinematics::Solution& s) {
        JointVector d = s.joints - joints;
        for (int j = 3; j < 5; ++j) d[j] = std::remainder(d[j], 2 * std::numbers::pi);
        return d.cwiseAbs().maxCoeff() < same;
      });
    };
    EXPECT_TRUE(is_among(q, found, 1e-9));
    for (const kinematics::Solution& s : found.solutions) {
      EXPECT_FALSE(s.singular);
      const Pose back = kinematics::forward(closed, s.joints).poses.at(0);
      EXPECT_LT((back.p - poses[0].p).norm() + (back.R.col(2) - poses[0].R.col(2)).norm(), 1e-11);
      EXPECT_TRUE(is_among(s.joints, others, 1e-4 / std::max(0.01, std::abs(std::sin(s.joints[4])))));
    }
    EXPECT_EQ(others.solutions.size(), 2u);
    ++judged;
  }
  EXPECT_GT(judged, 50);
}

// A delta with a wrist of three joints, whose tool tip lies beside its last axis.
TEST(Stages, AWristOfThreeJointsOnADelta) {
  const AnyMachine m = read(
      "family = \"stages\"\ntask = \"pose\"\n[[stage]]\nmachine = \"delta-picker\"\n[[stage]]\nmount = { x_mm = 20, "
      "z_mm = -30, a_deg = 170 }\nhome = [0, 40, 0]\n[stage.machine]\nfamily = \"serial\"\ndh = [\n{ d_mm = 60, "
      "alpha_deg "
      "= 90 },\n{ alpha_deg = -90 },\n{ d_mm = 80 },\n]\ntool = { x_mm = 15, z_mm = 40, b_deg = 25 }\nlimits = [\n{ "
      "min_deg = -200, max_deg = 200 },\n{ min_deg = -120, max_deg = 120 },\n{ min_deg = -360, max_deg = 360 },\n]\n");
  std::mt19937 random(4);
  std::uniform_real_distribution<double> unit(-1, 1);
  const Pose home = kinematics::home_pose(m).value();
  for (int k = 0; k < 200; ++k) {
    SCOPED_TRACE(k);
    Pose X = home;
    X.p += 0.1 * Vec3(unit(random), unit(random), unit(random));
    X.R = rotation_of(2 * Vec3(unit(random), unit(random), unit(random))) * X.R;
    const auto found = kinematics::inverse(m, X);
    ASSERT_EQ(found.solutions.size(), 2u * 8u) << found.reason;  // of the wrist, of the delta's arms
    int flipped = 0;
    for (const kinematics::Solution& s : found.solutions) {
      EXPECT_LT(std::visit([&](const auto& machine) { return kinematics::closure_residual(machine, X, s.joints); }, m),
                1e-12);
      flipped += std::abs(s.joints[4] + found.solutions[0].joints[4]) < 1e-9 ? 1 : 0;
    }
    EXPECT_EQ(flipped, 8);
    // From joints near one of them the search stays with it.
    const auto near = kinematics::inverse_near(m, X, found.solutions[1].joints + JointVector::Constant(6, 1e-3));
    ASSERT_FALSE(near.solutions.empty());
    EXPECT_LT((near.solutions[0].joints - found.solutions[1].joints).cwiseAbs().maxCoeff(), 1e-6);
  }
  // Axes 1 and 3 in line: one posture, an example, with joint 1 as at home.
  JointVector straight = kinematics::inverse(m, home).solutions.at(0).joints;
  straight.tail<3>() << 0.5, 0, 0.25;
  const auto singular = kinematics::inverse(m, kinematics::forward(m, straight).poses.at(0));
  ASSERT_EQ(singular.solutions.size(), 8u);
  EXPECT_TRUE(singular.solutions[0].singular);
  EXPECT_NEAR(singular.solutions[0].joints[3], 0, 1e-12);
  EXPECT_NEAR(singular.solutions[0].joints[5], 0.75, 1e-9);
}

// A row that follows joint 4 by half its angle: a turn of joint 4 alone is another pose.
TEST(Stages, AJointThatTurnsAnotherByHalfIsNotShiftedAlone) {
  std::string wrist = machine::to_toml(test::load("tricept-wrist"));
  const std::size_t second = wrist.rfind("alpha_deg = -90");
  ASSERT_NE(second, std::string::npos);
  wrist.insert(second, "coupled_to = 1, coupling = 0.5, ");
  const std::string arm =
      "family = \"serial\"\ndh = [ { d_mm = 400, alpha_deg = -90 }, { a_mm = 500 }, { alpha_deg = -90 }, { d_mm = 500, "
      "a_mm "
      "= 20, alpha_deg = 90 }, { alpha_deg = -90, coupled_to = 4, coupling = 0.5 }, { d_mm = 100, coupled_to = 4, "
      "coupling "
      "= 0.3 } ]\ntool = { z_mm = 100, a_deg = 180 }\nlimits = [ { min_deg = -350, max_deg = 350 }, { min_deg = -350, "
      "max_deg = 350 }, { min_deg = -350, max_deg = 350 }, { min_deg = -350, max_deg = 350 }, { min_deg = -350, "
      "max_deg = "
      "350 }, { min_deg = -350, max_deg = 350 } ]\n";
  for (const AnyMachine& m : {read(wrist), read(arm)}) {
    std::mt19937 random(8);
    std::uniform_real_distribution<double> unit(-1, 1);
    const int n = kinematics::joint_count(m);
    int solutions = 0;
    for (int k = 0; k < 10; ++k) {
      JointVector q = JointVector::NullaryExpr(n, [&] { return 1.5 * unit(random); });
      if (n == 5) q.head<3>() = JointVector::NullaryExpr(3, [&] { return 0.95 + 0.15 * unit(random); });
      const auto poses = kinematics::forward(m, q).poses;
      if (poses.empty()) continue;
      const Pose& X = poses[0];
      auto all = kinematics::inverse(m, X).solutions;
      const auto near = kinematics::inverse_near(m, X, q + JointVector::Constant(n, 3.0)).solutions;
      all.insert(all.end(), near.begin(), near.end());
      for (const kinematics::Solution& s : all) {
        ++solutions;
        const Pose back = kinematics::forward(m, s.joints).poses.at(0);
        EXPECT_LT((back.p - X.p).norm() + (back.R.col(2) - X.R.col(2)).norm(), 1e-6) << k;
      }
    }
    EXPECT_GT(solutions, 10);
  }
}

TEST(Stages, SolutionsBeyondTheLimitsAreWhereTheyWereAsked) {
  const AnyMachine m = test::load("tricept-wrist");
  const auto& stages = std::get<machine::Stages>(m);
  for (const Vec3& p : {Vec3(0.01, 0.02, 1.9), Vec3(0.1, 0, 0.45), Vec3(0.3, 0.1, 0.5)}) {
    const Pose X{rotation_abc(units::from_deg(5), units::from_deg(5), 0), p};
    const auto solved = kinematics::inverse(m, X);
    ASSERT_FALSE(solved.solutions.empty());
    for (const kinematics::Solution& s : solved.solutions) {
      const Pose at = kinematics::settled(m, X, s.joints);
      EXPECT_LT((at.p - X.p).norm(), 1e-9);
      EXPECT_LT(angle_between(at.R.col(2), X.R.col(2)), 1e-9);
      EXPECT_LT(kinematics::closure_residual(stages, at, s.joints), 1e-9);
    }
    EXPECT_EQ(machine::reaches(stages, X, ~kinematics::LimitBits{0}), solved.reachable() != nullptr);
    EXPECT_TRUE(machine::reaches(stages, X, 0));
  }
}

TEST(Stages, ClosureAndParametersAreThoseOfTheWhole) {
  for (const char* name : {"tricept-wrist", "dynapod"}) {
    SCOPED_TRACE(name);
    const AnyMachine any = test::load(name);
    const auto& m = std::get<machine::Stages>(any);
    const Pose X = home_pose(m);
    const auto solved = kinematics::inverse(any, X);
    ASSERT_FALSE(solved.solutions.empty());
    const JointVector q = solved.solutions[0].joints;
    const Pose at = kinematics::settled(any, X, q);
    const std::vector<double> p = kinematics::nominal_parameters(m);
    const std::span<const double> joints(q.data(), static_cast<std::size_t>(q.size()));
    EXPECT_LT(closure(m, at, joints, std::span<const double>(p)).cwiseAbs().maxCoeff(), kSame);
    EXPECT_LT((kinematics::jacobian_by_closure(m, at, joints) - jacobian(m, at, q)).norm(), 1e-8);
    // Each parameter moves the tool as the closure says, by differences of the machine that has it.
    const Eigen::MatrixXd effect =
        -kinematics::closure_by_pose(m, at, joints, p)
             .completeOrthogonalDecomposition()
             .solve(kinematics::closure_by_parameters(m, at, joints, std::span<const double>(p)));
    constexpr double kStep = 1e-6;
    const std::vector<machine::Parameter> names = parameters(m);
    for (std::size_t i = 0; i < p.size(); ++i) {
      // Directions are made unit vectors when they are set.
      const std::string key = names[i].key;
      if (key.find("normal") != std::string::npos || key.find("axis") != std::string::npos ||
          key.find("direction") != std::string::npos)
        continue;
      std::array<Pose, 2> moved;
      for (const int side : {0, 1}) {
        std::vector<double> changed = p;
        changed[i] += side == 0 ? -kStep : kStep;
        const auto other = machine::with_parameters(any, changed);
        ASSERT_TRUE(other.has_value()) << key << ": " << to_string(other.error());
        moved[static_cast<std::size_t>(side)] =
            kinematics::forward_by_closure(std::get<machine::Stages>(*other), joints, at).X_MT;
      }
      Vec6 twist;
      twist << (moved[1].p - moved[0].p) / (2 * kStep),
          rotation_vector(moved[1].R * moved[0].R.transpose()) / (2 * kStep);
      EXPECT_LT((effect.col(static_cast<Eigen::Index>(i)) - twist).norm(), 1e-5 * (1 + twist.norm())) << key;
    }
  }
}

TEST(Stages, AGantryOnlyMovesTheTripod) {
  const AnyMachine m = test::load("dynapod"), tripod = test::load("tripod-z3");
  const Pose head =
      kinematics::settled(tripod, kinematics::pose_of(kinematics::task(tripod), {0.88, 0.1, -0.15})).value();
  JointVector q(5);
  q << 0.4, -0.25, kinematics::inverse(tripod, head).solutions.at(0).joints;
  const Pose X = kinematics::forward(m, q).poses.at(0);
  EXPECT_LT((X.p - head.p - Vec3(0.4, -0.25, 0)).norm(), kSame);
  EXPECT_LT((X.R - head.R).norm(), kSame);
}

TEST(Stages, SingleFiguresAreSetByTheirKeys) {
  const auto tip_at_home = [](const std::vector<machine::Override>& overrides) {
    const auto m = machine::load(test::source("machines/tricept-wrist.toml"), overrides);
    if (!m) throw std::runtime_error(to_string(m.error()));
    return kinematics::home_pose(*m)->p;
  };
  const Vec3 nominal = tip_at_home({});
  // 100 mm along the tube, which hangs upright at home.
  EXPECT_LT((tip_at_home({{"stage[2].mount.z_mm", "100"}}) - nominal + Vec3(0, 0, 0.1)).norm(), kSame);
  EXPECT_LT((tip_at_home({{"stage[1].machine.tool.z_mm", "310"}}) - nominal).norm(), kSame)
      << "home of the tripod is that of its tip";
  const auto m =
      machine::load(test::source("machines/tricept-wrist.toml"), {{"stage[1].machine.leg[1].max_mm", "1000"}});
  ASSERT_TRUE(m.has_value()) << to_string(m.error());
  EXPECT_NEAR(kinematics::joint_range(*m, 0).max, 1.0, 1e-12);
}

TEST(Stages, WhatCannotBeIsRefused) {
  const std::string tripod = "[[stage]]\nmachine = \"tricept\"\n";
  const std::string slide =
      "[[stage]]\n[stage.machine]\nfamily = \"serial\"\ndh = [{ joint = \"prismatic\" }]\n"
      "limits = [{ min_mm = -100, max_mm = 100 }]\n";
  const std::string head = "family = \"stages\"\n";
  EXPECT_EQ(id_of(head + "task = [\"x\", \"y\", \"z\"]\n" + tripod), "MA160");
  EXPECT_EQ(id_of(head + "task = \"pose\"\n" + tripod + tripod), "MA160");
  EXPECT_EQ(id_of(head + "task = \"pose\"\n" + tripod + "[[stage]]\nmachine = \"dynapod\"\n"), "MA160");
  EXPECT_EQ(id_of(head + "task = \"point\"\n" + slide + tripod), "MA161");
  EXPECT_EQ(id_of(head + "task = \"pose\"\n" + slide + tripod), "MA161");
  EXPECT_EQ(id_of(head + "task = \"point\"\n[[stage]]\nmachine = \"nowhere\"\n" + tripod), "MA100");
  std::string out_of_range = head + "task = [\"x\", \"y\", \"z\", \"C\"]\n" + slide + tripod;
  out_of_range.insert(out_of_range.find("[stage.machine]"), "home = [200]\n");
  EXPECT_EQ(id_of(out_of_range), "MA162");
  EXPECT_EQ(id_of(head + "task = \"point\"\n[[stage]]\nmachine = \"tricept\"\nturned = 1\n" + slide), "CF103");
}

/// A file that names itself ends in a message and not in a stack without end.
TEST(Stages, AFileMayNotNameItself) {
  const auto path = std::filesystem::temp_directory_path() / "polypod_stages_itself.toml";
  std::ofstream(path) << "family = \"stages\"\ntask = \"pose\"\n[[stage]]\nmachine = \"polypod_stages_itself.toml\"\n"
                         "[[stage]]\nmachine = \"tricept\"\n";
  const auto m = machine::load(path.string());
  std::filesystem::remove(path);
  ASSERT_FALSE(m.has_value());
  EXPECT_EQ(m.error().id, "MA160");
}

/// A tripod that hangs, mounted upside down over a table whose z points up: the whole does not hang.
TEST(Stages, WhatCarriesAMachineMayTurnItOver) {
  EXPECT_TRUE(kinematics::hangs_down(test::load("tricept")));
  EXPECT_FALSE(kinematics::hangs_down(test::load("tricept-wrist")));
  EXPECT_TRUE(kinematics::hangs_down(test::load("dynapod")));
  EXPECT_FALSE(kinematics::hangs_down(test::load("scissors")));
}

TEST(SpeedLimits, AreThoseOfTheMachineAndOfItsStages) {
  const double deg = units::from_deg(1);
  const std::vector<double> kuka = kinematics::speed_limits(test::load("kuka-kr210"));
  ASSERT_EQ(kuka.size(), 6u);
  EXPECT_NEAR(kuka[0], 123 * deg, 1e-12);
  EXPECT_NEAR(kuka[5], 219 * deg, 1e-12);
  EXPECT_TRUE(kinematics::speed_limits(test::load("lola50")).empty()) << "it says none";
  const auto m = machine::from_text(R"(
family = "stages"
task = ["x", "y", "z"]
[[stage]]
home = [0]
[stage.machine]
family = "serial"
dh = [ { joint = "prismatic" } ]
limits = [ { min_mm = -100, max_mm = 100, speed_mm_per_s = 250 } ]
[[stage]]
[stage.machine]
family = "parallel"
task = ["x", "y"]
home = { y_mm = 118 }
[[stage.machine.leg]]
drive = "crank"
base_mm = [-59, 0, 0]
axis = [0, 0, 1]
zero = [1, 0, 0]
arm_mm = 90
rod_mm = 90
platform_mm = [0, 0, 0]
min_deg = 20
max_deg = 200
speed_deg_per_s = 400
[[stage.machine.leg]]
drive = "crank"
base_mm = [59, 0, 0]
axis = [0, 0, 1]
zero = [1, 0, 0]
arm_mm = 90
rod_mm = 90
platform_mm = [0, 0, 0]
min_deg = -20
max_deg = 160
[[stage.machine.constraint]]
kind = "orientation"
[[stage.machine.constraint]]
kind = "plane"
platform_mm = [0, 0, 0]
base_mm = [0, 0, 0]
normal = [0, 0, 1]
)",
                                    "t.toml");
  ASSERT_TRUE(m) << to_string(m.error());
  const auto again = machine::from_text(machine::to_toml(*m), "again.toml");
  ASSERT_TRUE(again) << to_string(again.error());
  for (const machine::AnyMachine* of : {&*m, &*again}) {
    const std::vector<double> limits = kinematics::speed_limits(*of);
    ASSERT_EQ(limits.size(), 3u);
    EXPECT_NEAR(limits[0], 0.25, 1e-15);
    EXPECT_NEAR(limits[1], 400 * deg, 1e-12);
    EXPECT_TRUE(std::isinf(limits[2])) << "this one does not say";
  }
  EXPECT_FALSE(
      machine::from_text("family = \"serial\"\ntask = [\"x\"]\ndh = [ { joint = \"prismatic\" } ]\n"
                         "limits = [ { min_mm = -1, max_mm = 1, speed_mm_per_s = 0 } ]\n",
                         "t.toml"));
}

}  // namespace
}  // namespace polypod
