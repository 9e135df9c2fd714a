// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a machine of any family is made of: what deflects, how far it reaches, how it looks.
#pragma once

#include "polypod/machine/any_machine.hpp"
#include "polypod/machine/parts.hpp"

namespace polypod::kinematics {

/// Everything that deflects under load.
std::vector<machine::Element> elements(const machine::AnyMachine& machine);
/// What the tool does for a unit by which each of them deflects, at the joints q (rad or m). `X_MT` is the pose of the
/// joints where it is known, else null: a parallel machine has several poses of the same joints.
machine::ElementColumns element_columns(const machine::AnyMachine& machine, const machine::JointVector& q,
                                        const Pose* X_MT);
void set_compliance(machine::AnyMachine& machine, int element, double compliance);

/// A box that holds every point that the tool tip could reach by the lengths of the machine alone, up to several times
/// too wide: limits and orientations do not count. Cost: below 1 us, of stages 10.
machine::Reach reach(const machine::AnyMachine& machine);
/// The point through which a plane is laid where nobody says another: the tool tip at home, the origin of M for a
/// serial arm (which its file puts where the work is). m, in M.
Vec3 middle_of_work(const machine::AnyMachine& machine);

/// Whether the base is above the work and z of M points down: gravity, unless said otherwise, and pictures follow.
/// False of families that do not say.
bool hangs_down(const machine::AnyMachine& machine);

/// Base, rails, legs or links, platform, joints and tool in M: at home, arms with the tool tip at `tip` and R = 1.
machine::Outline outline(const machine::AnyMachine& machine, const Vec3& tip);
/// The same at the pose X_MT with the joints q (rad or m) that belong to it.
machine::Outline outline_at(const machine::AnyMachine& machine, const Pose& X_MT, const machine::JointVector& q);

}  // namespace polypod::kinematics
