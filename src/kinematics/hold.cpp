// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/kinematics/hold.hpp"

#include <Eigen/LU>
#include <Eigen/SVD>
#include <cmath>
#include <numbers>
#include <span>
#include <vector>

#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/closure.hpp"
#include "polypod/kinematics/families.hpp"

namespace polypod::kinematics {

void divide_rows(Eigen::Ref<Eigen::MatrixXd> A, Eigen::MatrixXd* B) {
  for (int i = 0; i < A.rows(); ++i) {
    const double along = A.row(i).head(3).norm(), whole = A.row(i).norm();
    const double unit = along > 1e-12 * whole ? along : whole;
    A.row(i) /= unit;
    if (B != nullptr) B->row(i) /= unit;
  }
}

namespace {

/// A of the closure, angles as lengths on `length`, its rows divided.
ClosureMatrix rows_of(const machine::AnyMachine& machine, const std::vector<double>& parameters, const Pose& X,
                      const machine::JointVector& q, double length) {
  ClosureMatrix A = std::visit(
      [&](const auto& m) {
        return closure_by_pose(m, X, std::span<const double>(q.data(), static_cast<std::size_t>(q.size())), parameters);
      },
      machine);
  A.rightCols(3) /= length;
  divide_rows(A);
  return A;
}

double least_singular_value(const ClosureMatrix& A) {
  return A.jacobiSvd().singularValues().tail<1>()[0];
}

}  // namespace

Hold hold(const machine::AnyMachine& machine, const Pose& X_MT, const machine::JointVector& q) {
  if (is_serial(machine)) return {};
  const Pose X = settled(machine, X_MT, q);
  const std::vector<double> p = std::visit([](const auto& m) { return nominal_parameters(m); }, machine);
  const ClosureMatrix A = rows_of(machine, p, X, q, dexterity(machine, X, q).characteristic_length);
  return {least_singular_value(A), A.rows() == A.cols() ? A.determinant() : 0};
}

HoldAnywhere::HoldAnywhere(const machine::AnyMachine& machine) : machine_(machine) {
  if (is_serial(machine)) return;
  parameters_ = std::visit([](const auto& m) { return nominal_parameters(m); }, machine);
  const auto home = home_pose(machine);
  if (!home) return;
  const InverseResult there = inverse(machine, *home);
  if (there.solutions.empty()) return;
  const machine::JointVector& q = there.solutions.front().joints;
  length_ = dexterity(machine, *home, q).characteristic_length;
}

Hold HoldAnywhere::at(const Pose& X, const machine::JointVector& q, double enough) const {
  if (is_serial(machine_)) return {};
  const ClosureMatrix A = rows_of(machine_, parameters_, X, q, length_);
  if (A.rows() != A.cols()) return {least_singular_value(A), 0};
  const double determinant = A.determinant();
  const double others = double(A.cols() - 1);
  const double bound = std::abs(determinant) / std::pow(A.squaredNorm() / others, others / 2);
  return {bound >= enough ? bound : least_singular_value(A), determinant};
}

HoldOnPath::At HoldOnPath::next(const Pose& X_MT, const machine::JointVector& q) {
  constexpr double kFar = 0.05;                                // of `control`
  constexpr double kWay = 1e-3, kTurn = units::from_deg(0.5);  // m, rad
  if (serial_) return At::held;
  const bool follows = known_;
  if (follows && last_.control > kFar && (X_MT.p - X_MT_.p).norm() < kWay &&
      (X_MT.R - X_MT_.R).norm() < std::numbers::sqrt2 * kTurn) {
    return At::held;
  }
  const Hold now = hold(machine_, X_MT, q);
  const bool turned_over = follows && now.determinant * last_.determinant < 0;
  known_ = true;
  X_MT_ = X_MT;
  last_ = now;
  if (!(now.control >= kNoHold)) return At::lost;
  if (turned_over) return At::passed;
  return now.control < kLittleHold ? At::hardly : At::held;
}

std::string in_words(HoldOnPath::At at) {
  switch (at) {
    case HoldOnPath::At::held:
      break;
    case HoldOnPath::At::hardly:
      return "close to singular (type 2): the drives hardly constrain the tool";
    case HoldOnPath::At::passed:
      return "the way there passes a singular pose (type 2), where the drives do not constrain the tool";
    case HoldOnPath::At::lost:
      return "singular (type 2): the drives do not constrain the tool";
  }
  return "";
}

}  // namespace polypod::kinematics
