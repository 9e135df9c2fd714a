// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Machines with more drives than their task has coordinates.
#pragma once

#include "polypod/machine/any_machine.hpp"

namespace polypod::kinematics {

/// More drives than coordinates either leave a joint free, as of an arm with seven joints: the drives can move while
/// the tool stays; or they are more legs than freedoms, which agree at the poses of the machine alone. Told apart at
/// home, 1e-3 rad or m along the motion of the drives that the tool feels least: joints of the second kind do not close
/// there. Both are false where there are no more drives than coordinates. Machines without a home are arms. Cost: a
/// forward kinematics.
bool leaves_a_joint_free(const machine::AnyMachine& machine);
bool has_more_legs_than_freedoms(const machine::AnyMachine& machine);

}  // namespace polypod::kinematics
