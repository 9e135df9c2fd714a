// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the numbers of a machine count from and in which direction, where its parameters alone do not say it.
#pragma once

#include <string>
#include <vector>

#include "polypod/machine/any_machine.hpp"

namespace polypod::kinematics {

/// Sentences for people, in the order of the machine's joints: of a chain the convention of its table, joints that
/// count against the axis of their row, joints that turn with another one, and locked joints. Empty where there is
/// none.
std::vector<std::string> conventions(const machine::AnyMachine& machine);

}  // namespace polypod::kinematics
