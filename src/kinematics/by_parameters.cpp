// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/kinematics/by_parameters.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "polypod/kinematics/closure.hpp"
#include "polypod/kinematics/families.hpp"
#include "polypod/kinematics/hold_constraints.hpp"

namespace polypod::kinematics {

using machine::AnyMachine;
using machine::JointVector;

Eigen::MatrixXd twist_by_parameters(const AnyMachine& machine, const Pose& target, const JointVector& q) {
  const Pose X_MT = settled(machine, target, q);
  const std::span<const double> joints(q.data(), static_cast<std::size_t>(q.size()));
  return std::visit(
      [&](const auto& m) -> Eigen::MatrixXd {
        const std::vector<double> p = nominal_parameters(m);
        ClosureMatrix A = closure_by_pose(m, X_MT, joints, std::span<const double>(p));
        Eigen::MatrixXd F = closure_by_parameters(m, X_MT, joints, std::span<const double>(p));
        hold_constraints(m, A, F);
        return -ClosureSolver(A).solve_many(F);
      },
      machine);
}

Mat3 tip_covariance(const AnyMachine& machine, const Pose& X_MT, const JointVector& q,
                    const Eigen::MatrixXd& covariance) {
  const Eigen::MatrixXd G = twist_by_parameters(machine, X_MT, q).topRows(3);
  return G * covariance * G.transpose();
}

double largest_deviation(const Mat3& covariance) {
  return std::sqrt(
      std::max(0.0, Eigen::SelfAdjointEigenSolver<Mat3>(covariance, Eigen::EigenvaluesOnly).eigenvalues()[2]));
}

}  // namespace polypod::kinematics
