// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What of a compliant machine counts as rigid.
#pragma once

#include <string>

#include "polypod/geometry/pose.hpp"
#include "polypod/machine/any_machine.hpp"

namespace polypod::statics {

/// "without a compliance in the machine file, so counted as rigid: leg 1, stage 2": the elements without a compliance
/// where others of their kind have one, and the stages in which none has; empty where there are none, or the machine
/// has no compliance at all.
std::string rigid_parts_in_words(const machine::AnyMachine& machine);

/// "the tool tip does not move along z whatever the load: what holds it there (constraints, guides, bearings) counts as
/// rigid", from a compliance in M, of directions along the axes in which none of its elements moves the tip (`noise`,
/// m/N: rounding_of_tip). Empty where there are none, or where the tip does not move at all.
std::string held_directions_in_words(const Mat6& C, double noise);

}  // namespace polypod::statics
