// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/kinematics/hold.hpp"

#include <Eigen/LU>
#include <Eigen/SVD>
#include <numbers>
#include <span>
#include <vector>

#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/closure.hpp"
#include "polypod/kinematics/families.hpp"

namespace polypod::kinematics {

void divide_rows(Eigen::MatrixXd& A, Eigen::MatrixXd* B) {
  for (int i = 0; i < A.rows(); ++i) {
    const double along = A.row(i).head(3).norm(), whole = A.row(i).norm();
    const double unit = along > 1e-12 * whole ? along : whole;
    A.row(i) /= unit;
    if (B != nullptr) B->row(i) /= unit;
  }
}

Hold hold(const machine::AnyMachine& machine, const Pose& X_MT, const machine::JointVector& q) {
  if (is_serial(machine)) return {};
  const Pose X = settled(machine, X_MT, q);
  Eigen::MatrixXd A;
  std::visit(
      [&](const auto& m) {
        const std::vector<double> p = nominal_parameters(m);
        A = closure_by_pose(m, X, std::span<const double>(q.data(), static_cast<std::size_t>(q.size())), p);
      },
      machine);
  A.rightCols(3) /= dexterity(machine, X, q).characteristic_length;
  divide_rows(A);
  Hold out;
  out.determinant = A.rows() == A.cols() ? A.determinant() : 0;
  out.control = A.jacobiSvd().singularValues().tail<1>()[0];
  return out;
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
