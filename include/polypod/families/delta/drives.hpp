// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How the drives of a delta move when its tool does.
#pragma once

#include "polypod/families/delta/kinematics.hpp"
#include "polypod/motion/cycles.hpp"

namespace polypod::motion {

/// The drives of a tool that moves, on their first roots. With y = X + P - tool - S(q), |y| = c, the derivatives follow
/// from y . y' = 0, y' . y' + y . y'' = 0 and 3 y' . y'' + y . y''' = 0, each linear in the next derivative of q.
/// Infinite where y . dS/dq = 0 (singular of type 1). Cost: 0.1 us a drive.
Sample drives_of(const machine::RotaryDelta& m, double t, const Motion& tool);
Sample drives_of(const machine::LinearDelta& m, double t, const Motion& tool);

}  // namespace polypod::motion
