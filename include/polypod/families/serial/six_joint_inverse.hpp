// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The closed inverse of an arm with six joints, whichever of them its axes have.
#pragma once

#include <optional>
#include <variant>

#include "polypod/families/serial/pieper.hpp"
#include "polypod/families/serial/spherical_wrist.hpp"
#include "polypod/families/serial/three_parallel.hpp"

namespace polypod::machine {

/// The closed inverses with six joints. Each has `of(arm)`, `solve` into SixJointBranches, `solve` with limits as a
/// list, and `violations`, so that std::visit with one lambda asks any of them.
using SixJointInverse = std::variant<SphericalWristInverse, ThreeParallelInverse, PieperInverse>;

/// The first of them, in this order, that the arm's axes have: the forms with named postures before the one with
/// numbered ones. Nothing if the arm has none. That of this thread's last arm is at hand.
std::optional<SixJointInverse> six_joint_inverse(const SerialArm& arm);
/// Whether an arm of six joints has one of them, or would have one if its joints were not coupled: then inverse() has
/// their branches.
bool has_six_joint_branches(const SerialArm& arm);

}  // namespace polypod::machine
