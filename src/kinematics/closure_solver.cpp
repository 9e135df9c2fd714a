// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/kinematics/closure_solver.hpp"

#include <Eigen/SVD>

namespace polypod::kinematics {

ClosureSolver::ClosureSolver(const ClosureMatrix& A) : decomposed_(A) {}
Vec6 ClosureSolver::solve(const ClosureVector& b) const {
  return decomposed_.solve(b);
}
ClosureMatrix ClosureSolver::solve_columns(const ClosureMatrix& B) const {
  return decomposed_.solve(B);
}
Eigen::MatrixXd ClosureSolver::solve_many(const Eigen::MatrixXd& B) const {
  return decomposed_.solve(B);
}

Eigen::VectorXd singular_values(const Eigen::MatrixXd& A) {
  return A.jacobiSvd().singularValues();
}

}  // namespace polypod::kinematics
