// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Linear systems with the derivatives of a closure. Compiled once: a decomposition of Eigen costs each file that names
// one some ten seconds.
#pragma once

#include <Eigen/QR>

#include "polypod/geometry/pose.hpp"
#include "polypod/machine/common.hpp"

namespace polypod::kinematics {

using machine::ClosureVector;
/// Equations x unknowns (six of the pose, or as many as there are joints).
using ClosureMatrix =
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, machine::kMaxEquations, machine::kMaxJoints>;

/// x of A x = b for the derivatives A of a closure by the pose (equations x 6): the shortest of those with the least
/// |A x - b|, by complete orthogonal decomposition (A may have more rows than columns, or lack rank at singular poses).
class ClosureSolver {
 public:
  explicit ClosureSolver(const ClosureMatrix& A);
  [[nodiscard]] Vec6 solve(const ClosureVector& b) const;
  [[nodiscard]] ClosureMatrix solve_columns(const ClosureMatrix& B) const;
  [[nodiscard]] Eigen::MatrixXd solve_many(const Eigen::MatrixXd& B) const;

 private:
  Eigen::CompleteOrthogonalDecomposition<ClosureMatrix> decomposed_;
};

/// Singular values of any matrix, falling.
Eigen::VectorXd singular_values(const Eigen::MatrixXd& A);

}  // namespace polypod::kinematics
