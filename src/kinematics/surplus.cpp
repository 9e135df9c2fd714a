// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/kinematics/surplus.hpp"

#include <Eigen/SVD>

#include "polypod/kinematics/any_machine.hpp"

namespace polypod::kinematics {
namespace {

bool has_surplus(const machine::AnyMachine& m) {
  return joint_count(m) > coordinate_count(task(m));
}

}  // namespace

bool leaves_a_joint_free(const machine::AnyMachine& m) {
  if (!has_surplus(m)) return false;
  const std::optional<Pose> home = home_pose(m);
  if (!home) return true;
  const InverseResult at_home = inverse(m, *home);
  if (at_home.solutions.empty()) return true;
  constexpr double kFar = 1e-3;  // rad or m
  const JointVector& q = at_home.solutions.front().joints;
  const Eigen::MatrixXd J = jacobian(m, settled(m, *home).value_or(*home), q);
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(J, Eigen::ComputeFullV);
  const JointVector moved = q + kFar * svd.matrixV().rightCols<1>();
  return !forward(m, moved).poses.empty();
}

bool has_more_legs_than_freedoms(const machine::AnyMachine& m) {
  return has_surplus(m) && !leaves_a_joint_free(m);
}

}  // namespace polypod::kinematics
