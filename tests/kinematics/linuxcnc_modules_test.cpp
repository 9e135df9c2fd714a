// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Machines of legs against LinuxCNC's genuine pentakins and tripodkins, arms against pumakins and genserkins (recorded,
// see data/README.md).
#include <gtest/gtest.h>

#include <fstream>
#include <set>
#include <sstream>

#include "machines.hpp"
#include "paths.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/families.hpp"

namespace polypod {
namespace {

using kinematics::JointVector;
using machine::AnyMachine;

constexpr std::size_t kRows = 48;
// m: both sides compute struts of up to 1.5 m from the same figures, with some tens of roundings of 2e-16 of them.
constexpr double kInverse = 1e-14;
// m and rad: rounding of the joints (1e-16 m) carried to the pose near singular poses, where pentakins leaves most
// over.
constexpr double kForward = 1e-12;
// m and rad: pentakins ends its forward at changes of 1e-9 mm or deg; up to 4e-10 is left over (data/README.md).
constexpr double kForwardOfModule = 2e-11;

struct Row {
  std::vector<double> pose, joints, forward;  ///< m and rad, LinuxCNC's frame
};

std::string data(const std::string& file) {
  return test::source("tests/kinematics/data/" + file);
}

/// Rows of `coordinates` of the pose, `joints` joints and the pose again.
std::vector<Row> recorded(const std::string& name, int coordinates, int joints) {
  std::ifstream file(data(name + ".csv"));
  std::vector<Row> rows;
  std::string line;
  std::getline(file, line);  // the pins
  std::getline(file, line);  // the columns
  while (std::getline(file, line)) {
    std::istringstream cells(line);
    std::vector<double> v;
    for (std::string cell; std::getline(cells, cell, ',');) v.push_back(std::stod(cell));
    if (v.size() != static_cast<std::size_t>(2 * coordinates + joints)) throw std::runtime_error("a row of " + name);
    const auto pose = [&](int begin) {
      std::vector<double> out;
      for (int i = 0; i < coordinates; ++i) {
        const double value = v[static_cast<std::size_t>(begin + i)];
        out.push_back(i < 3 ? units::from_mm(value) : units::from_deg(value));
      }
      return out;
    };
    Row row{pose(0), {}, pose(coordinates + joints)};
    for (int i = 0; i < joints; ++i) {
      row.joints.push_back(units::from_mm(v[static_cast<std::size_t>(coordinates + i)]));
    }
    rows.push_back(row);
  }
  return rows;
}

double farthest(const std::vector<double>& a, const std::vector<double>& b) {
  double out = 0;
  for (std::size_t i = 0; i < a.size(); ++i) out = std::max(out, std::abs(a[i] - b[i]));
  return out;
}

/// The inverse gives the module's joints, and the forward the pose that was asked, from the seed that the module had.
/// `lowered`: by how much LinuxCNC's z lies above that of the tool tip, m.
void compare(const AnyMachine& m, const Row& row, double lowered = 0) {
  const machine::Task task = kinematics::task(m);
  std::vector<double> coordinates = row.pose, module = row.forward;
  coordinates[2] -= lowered;
  module[2] -= lowered;
  const auto inverse = kinematics::inverse(m, kinematics::pose_of(task, coordinates));
  ASSERT_EQ(inverse.solutions.size(), 1U) << inverse.reason;
  const JointVector& q = inverse.solutions.front().joints;
  EXPECT_EQ(inverse.solutions.front().violations, 0U);
  ASSERT_EQ(q.size(), static_cast<Eigen::Index>(row.joints.size()));
  EXPECT_LT(farthest({q.begin(), q.end()}, row.joints), kInverse);

  std::vector<double> seed = coordinates;
  for (int i = 0; i < task.size(); ++i) {
    seed[static_cast<std::size_t>(i)] += task.is_angle(i) ? units::from_deg(3) : units::from_mm(3);
  }
  const JointVector joints = Eigen::Map<const Eigen::VectorXd>(row.joints.data(), q.size());
  const auto forward = machine::forward_from(std::get<machine::Parallel>(m), joints, kinematics::pose_of(task, seed));
  ASSERT_TRUE(forward.converged);
  const std::vector<double> found = kinematics::coordinates_of(task, forward.X_MT);
  EXPECT_LT(farthest(found, coordinates), kForward);
  EXPECT_LT(farthest(found, module), kForwardOfModule);
}

/// The sign of det F_X: poses of another sign are in another assembly mode, beyond singular poses.
bool is_positive(const machine::Parallel& m, const Pose& X, const JointVector& q) {
  const machine::EquationRows rows = machine::closure_rows(m, X, q);
  EXPECT_EQ(rows.A.rows(), 6);
  return Mat6(rows.A).determinant() > 0;
}

/// `folded`: rows in home's mode to whose joints the straight way of joints from home leads over a singular pose.
void expect_pentapod(const std::string& name, double lowered, const std::set<std::size_t>& folded, int beyond) {
  const AnyMachine m = test::load(data(name + ".toml"));
  const auto& legs = std::get<machine::Parallel>(m);
  const Pose home = *kinematics::home_pose(m);
  const bool side = is_positive(legs, home, *machine::joints_of(legs, home));
  const std::vector<Row> rows = recorded(name, 5, 5);
  ASSERT_EQ(rows.size(), kRows);
  int other_side = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    SCOPED_TRACE(i);
    compare(m, rows[i], lowered);

    std::vector<double> asked = rows[i].pose;
    asked[2] -= lowered;
    const JointVector q = Eigen::Map<const Eigen::VectorXd>(rows[i].joints.data(), 5);
    const auto forward = kinematics::forward(m, q);
    ASSERT_EQ(forward.poses.size(), 1U);
    const bool is_beyond = is_positive(legs, kinematics::pose_of(kinematics::task(m), asked), q) != side;
    other_side += is_beyond;
    const double miss = farthest(kinematics::coordinates_of(kinematics::task(m), forward.poses.front()), asked);
    if (is_beyond) {
      EXPECT_GT(miss, 1e-3);
    } else if (!folded.contains(i)) {
      EXPECT_LT(miss, kForward);
    }
  }
  EXPECT_EQ(other_side, beyond);
}

TEST(LinuxCncModules, PentakinsAsItIsLoaded) {
  expect_pentapod("pentakins_defaults", 0, {22, 35}, 4);
}

TEST(LinuxCncModules, PentakinsWithAToolAndUnlikeRings) {
  expect_pentapod("pentakins_tool", 0.120, {}, 3);
}

/// A turn about the tool axis, that the rings do not see, makes no other pose of one.
TEST(LinuxCncModules, PosesOfOnePentapodAreListedOnce) {
  const AnyMachine m = test::load(data("pentakins_defaults.toml"));
  const machine::Task task = kinematics::task(m);
  const Row row = recorded("pentakins_defaults", 5, 5)[38];
  const auto all = kinematics::forward_all(m, Eigen::Map<const Eigen::VectorXd>(row.joints.data(), 5));
  ASSERT_GT(all.poses.size(), 1U);
  EXPECT_LT(farthest(kinematics::coordinates_of(task, all.poses.front()), row.pose), kForward);
  for (std::size_t i = 0; i < all.poses.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      EXPECT_GT(
          farthest(kinematics::coordinates_of(task, all.poses[i]), kinematics::coordinates_of(task, all.poses[j])),
          1e-3);
    }
  }
}

TEST(LinuxCncModules, TripodkinsAboveAndBelowItsMotors) {
  const std::string file = data("tripodkins.toml");
  const AnyMachine below = test::load(file), above = test::load(file, {{"home.z_mm", "500"}});
  const std::vector<Row> rows = recorded("tripodkins", 3, 3);
  ASSERT_EQ(rows.size(), kRows);
  int count_above = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    SCOPED_TRACE(i);
    const bool is_above = rows[i].pose[2] > 0;
    count_above += is_above;
    const AnyMachine& m = is_above ? above : below;
    compare(m, rows[i]);
    // From home, in its assembly mode, as every command asks it.
    const auto forward = kinematics::forward(m, Eigen::Map<const Eigen::Vector3d>(rows[i].joints.data()));
    ASSERT_EQ(forward.poses.size(), 1U);
    EXPECT_LT(farthest(kinematics::coordinates_of(kinematics::task(m), forward.poses.front()), rows[i].pose), kForward);
  }
  EXPECT_EQ(count_above, 24);
}

/// The pose of the module's joints is the module's, and they are among all branches of the closed inverse.
void expect_arm(const std::string& name) {
  // m and rad: both sides' roundings, those of the file (deg) and of the module's matrices.
  constexpr double kArm = 1e-12;
  // rad: of the module's inverse, next to singular poses.
  constexpr double kJoints = 1e-9;
  const AnyMachine m = test::load(data(name + ".toml"));
  const auto& arm = std::get<machine::SerialArm>(m);
  ASSERT_TRUE(machine::has_closed_inverse(arm));
  const std::vector<Row> rows = recorded(name, 6, 6);
  ASSERT_EQ(rows.size(), kRows);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    SCOPED_TRACE(i);
    JointVector q(6);
    for (int k = 0; k < 6; ++k) {  // read as mm
      q[k] = units::from_deg(units::to_mm(rows[i].joints[static_cast<std::size_t>(k)]));
    }
    const Pose asked = kinematics::pose_of(machine::Task::pose, rows[i].pose),
               module = kinematics::pose_of(machine::Task::pose, rows[i].forward), X = machine::forward(arm, q);
    EXPECT_LT((X.p - module.p).norm() + (X.R - module.R).norm(), kArm);
    double nearest = 10;
    for (const kinematics::Solution& s : machine::inverse(arm, asked).solutions) {
      nearest = std::min(nearest, test::apart(s.joints, q));
    }
    EXPECT_LT(nearest, kJoints);
  }
}

TEST(LinuxCncModules, Pumakins) {
  expect_arm("pumakins");
}

TEST(LinuxCncModules, Genserkins) {
  expect_arm("genserkins");
}

}  // namespace
}  // namespace polypod
