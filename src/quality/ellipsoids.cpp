// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/quality/ellipsoids.hpp"

#include <Eigen/SVD>
#include <cmath>
#include <limits>

#include "polypod/quality/singularity.hpp"

namespace polypod::quality {
namespace {

constexpr double kNothing = 1e-12;  // of the largest half axis

/// The image of the unit ball under three rows of a Jacobian.
Ellipsoid image_of(const Eigen::Matrix<double, 3, Eigen::Dynamic>& J) {
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(J, Eigen::ComputeFullU);
  Ellipsoid out;
  out.half_axes.head(svd.singularValues().size()) = svd.singularValues();
  for (double& a : out.half_axes) a = a > kNothing * out.half_axes[0] ? a : 0;
  out.directions = svd.matrixU();
  // One of the two ways along each axis: its largest part is positive.
  for (int k = 0; k < 3; ++k) {
    Eigen::Index largest = 0;
    out.directions.col(k).cwiseAbs().maxCoeff(&largest);
    if (out.directions(largest, k) < 0) out.directions.col(k) *= -1;
    for (double& part : out.directions.col(k)) part = std::abs(part) > kNothing ? part : 0;
  }
  return out;
}

/// The ellipsoid whose products with `e` are 1, largest first.
Ellipsoid dual_of(const Ellipsoid& e) {
  Ellipsoid out;
  for (int k = 0; k < 3; ++k) {
    const double a = e.half_axes[2 - k];
    out.half_axes[k] = a > 0 ? 1 / a : std::numeric_limits<double>::infinity();
    out.directions.col(k) = e.directions.col(2 - k);
  }
  return out;
}

}  // namespace

std::optional<Ellipsoids> ellipsoids(const kinematics::JacobianMatrix& J) {
  if (!J.allFinite()) return {};
  Ellipsoids out;
  out.velocity = image_of(J.topRows<3>());
  out.rotation = image_of(J.bottomRows<3>());
  out.force = dual_of(out.velocity);
  out.moment = dual_of(out.rotation);
  return out;
}

std::optional<Ellipsoids> ellipsoids(const kinematics::AnyMachine& machine, const Pose& X_MT,
                                     const kinematics::JointVector& q) {
  constexpr double kHeld = 1e-9;
  if (!kinematics::is_serial(machine) && singularity(machine, X_MT, q).control < kHeld) return {};
  return ellipsoids(kinematics::jacobian(machine, X_MT, q));
}

}  // namespace polypod::quality
