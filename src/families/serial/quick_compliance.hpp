// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <string>

#include "polypod/families/serial/kinematics.hpp"

namespace polypod::machine {

/// The compliance C of a tool tip at p_M with the tool axis along `axis`, m/N, and the joints there; false where no
/// solution is within the limits. C = sum of c_i v_i v_i^T, v_i the columns of the Jacobian's rows of position.
using QuickCompliance = std::function<bool(const Vec3& p_M, const Vec3& axis, JointVector& joints, Mat3& C)>;

/// Of arms with a closed inverse of point and axis, in the posture of that name; without a name in the first within the
/// limits. The arm must outlive what is given. Cost: below 1 us a tip.
inline QuickCompliance quick_compliance(const SerialArm& arm, const std::string& posture) {
  auto wrist = WristInverse::of(arm);
  if (!wrist) return {};
  int wanted = posture.empty() ? WristInverse::kBranches : 0;
  while (wanted < WristInverse::kBranches && branch_name(arm, unsigned(wanted)) != posture) ++wanted;
  if (!posture.empty() && wanted == WristInverse::kBranches) return {};
  return [&arm, wanted, inverse = std::move(*wrist), branches = WristInverse::Branches()](
             const Vec3& p_M, const Vec3& axis, JointVector& joints, Mat3& C) mutable {
    inverse.solve(p_M, axis, branches);
    const auto within = [&](int k) { return branches.exists[k] && inverse.violations(branches.joints[k]) == 0; };
    const int b = wanted == WristInverse::kBranches ? inverse.first_within_limits(branches)
                  : within(wanted)                  ? wanted
                                                    : -1;
    if (b < 0) return false;
    joints = branches.joints[b];
    const ForwardJacobian fj = forward_jacobian(arm, joints, true);
    C.setZero();
    for (int i = 0; i < fj.J.cols(); ++i) {
      const Vec3 v = fj.J.col(i).head<3>();
      C.noalias() += (arm.dh[static_cast<std::size_t>(i)].compliance * v) * v.transpose();
    }
    return true;
  };
}

}  // namespace polypod::machine
