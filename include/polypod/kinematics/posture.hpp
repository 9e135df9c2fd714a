// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// In which posture a machine takes a pose: the branch of its inverse kinematics, by name.
#pragma once

#include <string>
#include <vector>

#include "polypod/kinematics/any_machine.hpp"

namespace polypod::kinematics {

/// The first solution within the limits; with the name of a posture (branch_name) the first of these in that posture.
/// Null where there is none.
const Solution* reachable_in(const AnyMachine& machine, const InverseResult& inverse, const std::string& posture);

/// The postures of the solutions within the limits, each once, in their order; without those of numeric searches, which
/// have no names.
std::vector<std::string> postures_of(const AnyMachine& machine, const InverseResult& inverse);

/// The names of all postures: of arms with a closed inverse those of its branches, of others those that the machine has
/// beside the middle of its joints' ranges, beyond the limits too; empty where its inverse names none. Cost: one
/// forward and one inverse.
std::vector<std::string> all_postures(const AnyMachine& machine);

/// The posture in which the joints q (rad or m) stand; empty where the inverse does not give them back, or does not
/// name its solutions.
std::string posture_of(const AnyMachine& machine, const JointVector& q);

/// Why `reachable_in` gives nothing: reason_of, or that the pose is within the limits in other postures alone.
std::string reason_of(const AnyMachine& machine, const InverseResult& inverse, const std::string& posture);

}  // namespace polypod::kinematics
