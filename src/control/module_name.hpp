// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the writers of LinuxCNC files share.
#pragma once

#include <string>
#include <vector>

#include "polypod/control/linuxcnc.hpp"

namespace polypod::control {

/// The name of the machine's module: small letters, digits and _, 25 characters at most.
std::string module_name_of(const std::string& machine);

/// Of each joint: -1 where a pose leaves its drive one position; else 1 where the joint is the higher of both (of a
/// rail the larger, of a crank the one on the side of growing angles of the direction in which its platform joint is
/// seen), 0 where it is the lower.
std::vector<int> module_roots(const AnyMachine& machine, const Pose& X_MT, const JointVector& q);

}  // namespace polypod::control
