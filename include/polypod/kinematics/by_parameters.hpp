// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a change of a machine's parameters does to its tool, and how uncertain parameters make the place of the tip.
#pragma once

#include "polypod/kinematics/any_machine.hpp"

namespace polypod::kinematics {

/// Coverage factor of all expanded uncertainties U.
inline constexpr double kCoverageFactor = 2;

/// The twist [v; w] of the tool in M by each parameter of kinematics::parameters, 6 x parameters, m and rad per m and
/// rad: -A^-1 F_p from the closure F(X, q, p) = 0, at the pose X_MT (settled, see any_machine.hpp) of the joints q.
/// First order; near singular poses (A loses rank) the least squares solution. Cost: 20 us.
Eigen::MatrixXd twist_by_parameters(const machine::AnyMachine& machine, const Pose& X_MT,
                                    const machine::JointVector& q);

/// Covariance of the tip's place in M, m^2, for parameters of this covariance (SI, in the order of
/// kinematics::parameters): G C G^T with the upper half of twist_by_parameters.
Mat3 tip_covariance(const machine::AnyMachine& machine, const Pose& X_MT, const machine::JointVector& q,
                    const Eigen::MatrixXd& covariance);

/// The standard deviation along the direction in which it is largest, of a vector of this covariance.
double largest_deviation(const Mat3& covariance);

}  // namespace polypod::kinematics
