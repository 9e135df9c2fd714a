// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/kinematics/free_joints.hpp"

#include <fmt/format.h>

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <variant>

#include "polypod/families/serial/cartesian.hpp"
#include "polypod/kinematics/hold.hpp"
#include "polypod/kinematics/surplus.hpp"

namespace polypod::kinematics {

namespace {

/// An orthonormal basis of the kernel of S J, lengths by the characteristic length; no columns where J says nothing.
Eigen::MatrixXd kernel(const machine::AnyMachine& machine, const Pose& X_MT, const machine::JointVector& q) {
  constexpr double kNone = 1e-9;
  if (has_more_legs_than_freedoms(machine) || hold(machine, X_MT, q).control < kNoHold) return {};
  const Pose X = settled(machine, X_MT, q);
  const double length = dexterity(machine, X, q).characteristic_length;
  JacobianMatrix J = jacobian(machine, X, q);
  for (int i = 0; i < q.size(); ++i) {
    if (joint_kind(machine, i) == machine::JointKind::prismatic) J.col(i) *= length;
  }
  J.topRows<3>() /= length;
  const Eigen::MatrixXd rows = task_jacobian(task(machine), J, X);
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(rows, Eigen::ComputeFullV);
  const Eigen::VectorXd& values = svd.singularValues();
  const Eigen::Index rank = (values.array() > kNone * values[0]).count();
  return svd.matrixV().rightCols(q.size() - rank);
}

}  // namespace

std::vector<int> free_joints(const machine::AnyMachine& machine, const Pose& X_MT, const machine::JointVector& q) {
  constexpr double kPart = 1e-6;
  const Eigen::MatrixXd ways = kernel(machine, X_MT, q);
  std::vector<int> out;
  for (Eigen::Index i = 0; i < ways.rows(); ++i) {
    if (ways.row(i).norm() > kPart) out.push_back(static_cast<int>(i));
  }
  return out;
}

bool free_joints_have_limits(const machine::AnyMachine& machine, const Pose& X_MT, const machine::JointVector& q,
                             const std::vector<double>& limits) {
  const auto known = [](double limit) { return std::isfinite(limit); };
  if (std::none_of(limits.begin(), limits.end(), known)) return false;
  if (std::all_of(limits.begin(), limits.end(), known)) return true;
  const std::vector<int> joints = free_joints(machine, X_MT, q);
  return std::all_of(joints.begin(), joints.end(),
                     [&](int joint) { return known(limits[static_cast<std::size_t>(joint)]); });
}

int freedoms_left(const machine::AnyMachine& machine, const Pose& X_MT, const machine::JointVector& q) {
  return static_cast<int>(kernel(machine, X_MT, q).cols());
}

bool is_head_on_linear_axes(const machine::AnyMachine& machine) {
  const auto* arm = std::get_if<machine::SerialArm>(&machine);
  return arm != nullptr && machine::CartesianInverse::of(*arm).has_value();
}

std::string in_words_free(const std::vector<int>& joints) {
  if (joints.empty()) return "";
  std::string names;
  for (std::size_t k = 0; k < joints.size(); ++k) {
    const char* before = k == 0 ? "" : k + 1 < joints.size() ? ", " : " and ";
    names += fmt::format("{}{}", before, joints[k] + 1);
  }
  return joints.size() == 1 ? fmt::format("joint {} can move while the tool stays", names)
                            : fmt::format("joints {} can move together while the tool stays", names);
}

}  // namespace polypod::kinematics
