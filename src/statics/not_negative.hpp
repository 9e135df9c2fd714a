// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Least squares with c >= 0, for the fits of compliances.
#pragma once

#include <Eigen/Dense>
#include <vector>

namespace polypod::statics {

/// Least squares with c >= 0 from the normal equations H c = g (H positive definite), by an active set: held at 0 is
/// what would be negative, and let go again what would grow. `free` says which are not held.
inline Eigen::VectorXd not_negative(const Eigen::MatrixXd& H, const Eigen::VectorXd& g, std::vector<bool>& free) {
  const int n = static_cast<int>(g.size());
  free.assign(static_cast<std::size_t>(n), true);
  Eigen::VectorXd c = Eigen::VectorXd::Zero(n);
  for (int round = 0; round < 10 * n; ++round) {
    Eigen::MatrixXd Hf = H;
    Eigen::VectorXd gf = g;
    for (int i = 0; i < n; ++i) {
      if (free[static_cast<std::size_t>(i)]) continue;
      Hf.row(i).setZero();
      Hf.col(i).setZero();
      Hf(i, i) = 1;
      gf[i] = 0;
    }
    c = Hf.ldlt().solve(gf);
    int worst = 0;
    if (c.minCoeff(&worst) < 0) {
      free[static_cast<std::size_t>(worst)] = false;
      continue;
    }
    const Eigen::VectorXd pull = g - H * c;
    int grows = -1;
    for (int i = 0; i < n; ++i) {
      if (!free[static_cast<std::size_t>(i)] && pull[i] > 1e-12 * g.norm() && (grows < 0 || pull[i] > pull[grows]))
        grows = i;
    }
    if (grows < 0) break;
    free[static_cast<std::size_t>(grows)] = true;
  }
  return c.cwiseMax(0.0);
}

}  // namespace polypod::statics
