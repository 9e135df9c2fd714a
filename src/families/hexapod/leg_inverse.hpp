// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/LU>
#include <Eigen/QR>

#include "polypod/geometry/pose.hpp"

namespace polypod::machine {

/// The inverse of the rows of six legs (leg_rows): the twist of the tool by their rates. Beside a singular pose, where
/// it is lost in rounding, the pseudoinverse, at more than twice the cost.
inline Mat6 inverse_of_legs(const Mat6& K) {
  constexpr double kRegular = 1e-6;  // of the largest pivot; those of turns are some tenths of a metre to begin with
  const Eigen::PartialPivLU<Mat6> lu(K);
  const auto pivots = lu.matrixLU().diagonal().cwiseAbs();
  if (pivots.minCoeff() > kRegular * pivots.maxCoeff()) return lu.inverse();
  return K.completeOrthogonalDecomposition().pseudoInverse();
}

}  // namespace polypod::machine
