// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What of a compliant machine counts as rigid.
#pragma once

#include <string>

#include "polypod/machine/any_machine.hpp"

namespace polypod::statics {

/// "without a compliance in the machine file, so counted as rigid: leg 1, stage 2": the elements without a compliance
/// where others of their kind have one, and the stages in which none has; empty where there are none, or the machine
/// has no compliance at all.
std::string rigid_parts_in_words(const machine::AnyMachine& machine);

}  // namespace polypod::statics
