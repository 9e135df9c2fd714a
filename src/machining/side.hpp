// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// On which side of the work a machine stands.
#pragma once

#include <optional>
#include <string>

#include "polypod/machine/any_machine.hpp"

namespace polypod::machining {

/// Z+ of a program is that of M. What to say of a machine with closed loops whose platform (with a tool of no length:
/// whose base) is below the tool tip at home: there Z+ leads away from the platform, and a cut to Z- back to it.
std::optional<std::string> note_on_side(const machine::AnyMachine& machine);

}  // namespace polypod::machining
