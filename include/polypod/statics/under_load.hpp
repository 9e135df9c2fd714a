// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a load does beyond C F: it turns the joints, and their levers with them.
#pragma once

#include <optional>

#include "polypod/kinematics/any_machine.hpp"

namespace polypod::statics {

/// The displacement of the tool tip under a constant force, m, in M.
struct UnderLoad {
  Vec3 linear = Vec3::Zero();  ///< C F, with the levers of the arm without the load
  Vec3 exact = Vec3::Zero();   ///< in balance where the arm stands under the load
};

/// Of a serial arm whose joints stand at q (rad or m) without the load:
///   q_i = q_i0 + c_i J_i(q)^T F  for every joint, locked ones with their brakes included,
/// by repeated insertion. The term K_C of Chen and Kao (stiffness under load, K_X = J^-T (K_q - K_C) J^-1, K_C =
/// dJ^T/dq F) is the first order of the difference of the two. Nothing for other machines, and where the balance does
/// not settle: a load near which the arm buckles. Cost: some 5 us.
std::optional<UnderLoad> under_load(const machine::AnyMachine& machine, const machine::JointVector& q, const Vec3& F);

}  // namespace polypod::statics
