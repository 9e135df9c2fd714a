// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The pose of a machine that moves.
#pragma once

#include "polypod/kinematics/any_machine.hpp"

namespace polypod::kinematics {

/// The pose of the joints q as `forward` gives it; of a parallel machine that of the assembly mode which Newton's
/// method reaches from `near`, where it reaches one: of a machine that moves, the mode that it is in. Cost: some
/// microseconds.
ForwardResult forward_near(const AnyMachine& machine, const JointVector& q, const Pose& near);

}  // namespace polypod::kinematics
