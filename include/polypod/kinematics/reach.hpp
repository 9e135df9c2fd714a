// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Where the tool of a machine could be at all, by the lengths of its links alone.
#pragma once

#include "polypod/machine/any_machine.hpp"

namespace polypod::kinematics {

/// A box in M, m.
struct Reach {
  Vec3 low = Vec3::Zero(), high = Vec3::Zero();
};
/// A box that holds every point that the tool tip could reach by the lengths of the machine alone, up to several times
/// too wide: limits and orientations do not count. Cost: below 1 us, of stages 10.
Reach reach(const machine::AnyMachine& machine);

/// The point through which a plane is laid where nobody says another: the tool tip at home, the origin of M for a
/// serial arm (which its file puts where the work is). m, in M.
Vec3 middle_of_work(const machine::AnyMachine& machine);

}  // namespace polypod::kinematics
