// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a pose leaves open: joints that can move while the tool stays where its task wants it.
#pragma once

#include <string>
#include <vector>

#include "polypod/kinematics/any_machine.hpp"

namespace polypod::kinematics {

/// The joints (from 0) that can move, alone or together, while the task's coordinates of the pose X_MT stay: those with
/// a part in the kernel of S J, S the rows of the task (task_jacobian) and J the Jacobian at the joints q of a
/// solution. Then the solution is one of a continuum, and its joints are an example. Arms with more joints than their
/// task has coordinates have such joints everywhere; other machines at singular poses of type 1 (a rotary axis along
/// the tool, a stretched wrist). Lengths of J are taken by the characteristic length of `dexterity`, singular values
/// below 1e-9 of the largest as 0. Empty of machines with more legs than freedoms, whose joints agree at the machine's
/// poses alone, and where the drives do not constrain the tool (type 2), where J says nothing. Cost: some 30 us.
std::vector<int> free_joints(const machine::AnyMachine& machine, const Pose& X_MT, const machine::JointVector& q);
/// Whether every one of these joints has a speed limit, so that speeds say whether a singular pose can be passed.
/// `limits`: rad/s or m/s, one a joint, infinite where there is none; empty: none is known. Cost: nothing where all or
/// none are known, else that of free_joints.
bool free_joints_have_limits(const machine::AnyMachine& machine, const Pose& X_MT, const machine::JointVector& q,
                             const std::vector<double>& limits);
/// In how many independent ways they can: the dimension of that kernel.
int freedoms_left(const machine::AnyMachine& machine, const Pose& X_MT, const machine::JointVector& q);

/// Whether linear axes carry a head of rotary axes (CartesianInverse): programs mill all day with its tool along the
/// first rotary axis, which is a singular pose, so that a condition number says little of its motions.
bool is_head_on_linear_axes(const machine::AnyMachine& machine);

/// "joint 5 can move while the tool stays", "joints 4 and 6 can move together while the tool stays"; empty for none.
std::string in_words_free(const std::vector<int>& joints);

}  // namespace polypod::kinematics
