// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "polypod/families/serial/machine.hpp"
#include "polypod/machine/common.hpp"

namespace polypod::machine {

/// The frames of an arm at the joints q (rad or m, of the joints that are not locked), in M: that of its base, then
/// that after each row of its table. The tool tip is the last one times X_FT. Cost: 20 ns a row.
std::vector<Pose> frames_of_table(const SerialArm& arm, const JointVector& q);

}  // namespace polypod::machine
