// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How the space that a machine reaches grows with its parameters: what keeps contacts from making it smaller.
#pragma once

#include "model.hpp"

namespace polypod::calibration {

/// The relative growth of a small volume round the target by each parameter, 1/m and 1/rad: the divergence of the
/// target's displacement field, sum_k d(v_k)/d(x_k), v = d(X p_TR)/d(parameter) at held joints, the target moved along
/// those of x, y, z that the machine's poses prescribe, its orientation held. It is the derivative of ln |det
/// d(target)/d(joints)| on the joints that so move it.
///
/// Why: a contact says that the tool stood at an unknown place c but for noise n in space, f(q, p) = c + n. What was
/// measured are joints, and their density is that of n times |det df/dq|. Least squares alone leave the determinant
/// out; then a smaller machine is always the likelier one, since it makes noise itself smaller. With it the estimate is
/// free of that bias.
///
/// By central differences of twist_by_parameters over 1e-5 of the machine's size. Zeros at a
/// singular pose. Cost: six Newton solutions and
/// 6 x 20 us.
Eigen::VectorXd dilatation_by_parameters(const AnyMachine& machine, const Pose& X_MT, const JointVector& q,
                                         const Vec3& target_T);

}  // namespace polypod::calibration
