// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Machines of legs against LinuxCNC's genuine pentakins and tripodkins (recorded, see data/README.md).
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "machines.hpp"
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
  return std::string(POLYPOD_TEST_DATA) + "/kinematics/data/" + file;
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

void expect_pentapod(const std::string& name, double lowered) {
  const AnyMachine m = test::load(data(name + ".toml"));
  const std::vector<Row> rows = recorded(name, 5, 5);
  ASSERT_EQ(rows.size(), kRows);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    SCOPED_TRACE(i);
    compare(m, rows[i], lowered);
  }
}

TEST(LinuxCncModules, PentakinsAsItIsLoaded) {
  expect_pentapod("pentakins_defaults", 0);
}

TEST(LinuxCncModules, PentakinsWithAToolAndUnlikeRings) {
  expect_pentapod("pentakins_tool", 0.120);
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

}  // namespace
}  // namespace polypod
