// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The further turns of the joints of an arm.
#pragma once

#include <vector>

#include "polypod/kinematics/any_machine.hpp"

namespace polypod::kinematics {

struct OtherTurns {
  int joint = 0;
  std::vector<double> angles;  ///< rad, within the limits, the smallest first
};

/// For each turning joint of an arm that has some: the angles, whole turns from that in q, at which the tool has the
/// same pose (to 1e-9 m and rad) and the joint is within its limits, the others as in q. Empty for parallel machines.
/// Joints with more than 20 turns are left out: they are as good as without limits. Cost: a forward() each.
std::vector<OtherTurns> other_turns(const AnyMachine& machine, const JointVector& q);

}  // namespace polypod::kinematics
