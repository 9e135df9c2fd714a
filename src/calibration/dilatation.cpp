// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "dilatation.hpp"

#include "polypod/kinematics/closure.hpp"

namespace polypod::calibration {

Eigen::VectorXd dilatation_by_parameters(const AnyMachine& machine, const Pose& X_MT, const JointVector& q,
                                         const Vec3& target_T) {
  constexpr double kStep = 1e-5;      // of the machine's size
  constexpr double kSingular = 1e-8;  // of the largest singular value
  std::vector<double> p;
  for (const machine::Parameter& one : kinematics::parameters(machine)) p.push_back(one.value);
  Eigen::VectorXd out = Eigen::VectorXd::Zero(std::ssize(p));
  const machine::Task task = kinematics::task(machine);
  const Eigen::MatrixXd J = kinematics::task_jacobian(task, kinematics::jacobian(machine, X_MT, q), X_MT);
  Eigen::JacobiSVD<Eigen::MatrixXd> svd(J, Eigen::ComputeThinU | Eigen::ComputeThinV);
  const auto& sigma = svd.singularValues();
  if (!J.allFinite() || !(sigma.tail<1>()[0] > kSingular * sigma[0])) return out;
  const double h = kStep * size_of(machine);
  for (int i = 0; i < task.size(); ++i) {
    const int k = static_cast<int>(task[i]);
    if (k > 2) continue;
    machine::JacobianMatrix along = machine::JacobianMatrix::Zero(6, 1);
    along(k, 0) = 1;
    const JointVector dq = svd.solve(kinematics::task_jacobian(task, along, X_MT));
    Eigen::VectorXd difference = Eigen::VectorXd::Zero(out.size());
    for (const double side : {1.0, -1.0}) {
      const JointVector there = q + side * h * dq;
      const auto at = forward_of(machine, Numbers(there.data(), std::size_t(there.size())), p,
                                 {X_MT.R, X_MT.p + side * h * Vec3::Unit(k)});
      if (!at.converged) return Eigen::VectorXd::Zero(out.size());
      const Eigen::MatrixXd G = twist_by_parameters(machine, at.X_MT, there);
      const Vec3 arm = at.X_MT.R * target_T;
      difference += side * (G.row(k) + (skew<double>(-arm).row(k) * G.bottomRows<3>())).transpose();
    }
    out += difference / (2 * h);
  }
  return out.allFinite() ? out : Eigen::VectorXd::Zero(out.size());
}

}  // namespace polypod::calibration
