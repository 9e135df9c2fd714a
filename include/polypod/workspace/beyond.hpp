// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Which part of a workspace a parallel machine comes to from home without passing a singular pose.
#pragma once

#include <optional>

#include "polypod/kinematics/hold.hpp"
#include "polypod/workspace/field.hpp"
#include "polypod/workspace/volume.hpp"

namespace polypod::workspace {

struct BeyondSingular {
  std::size_t points = 0;  ///< drawn from the workspace; 0 where the question has no meaning
  std::size_t beyond = 0;  ///< of them on the other side of singular poses
};

/// The sign of the determinant of A (kinematics::hold) at home. No way leads from one sign to the other but through a
/// singular pose of type 2 (JEL 6.3), where the drives do not hold the platform. 0 where that tells nothing: of serial
/// arms, where A is not square, where home is singular or the machine has none.
int side_of_home(const AnyMachine& machine);
/// How the drives hold a pose in the first posture that keeps the limits `heeded`; of machines that take any posture,
/// in one on home's `side` if there is one. Nothing where none keeps them.
std::optional<kinematics::Hold> reached_on_side(const AnyMachine& machine, const kinematics::HoldAnywhere& hold,
                                                const Pose& target, int side, kinematics::LimitBits heeded,
                                                double enough = kinematics::kLittleHold);

/// Draws points from a workspace (of a task without x, y, z: from the region of its coordinates) and
/// compares the sign of the determinant with side_of_home: as of a hexapod without limits of its joints, whose legs
/// reach the platform mirrored below its base, too. A sample, not a proof, and the same sign may still lie beyond.
/// Cost: below 10 ms; of machines whose inverse is a search some ms for each of up to 20 000 draws, mostly 400.
BeyondSingular beyond_singular(const AnyMachine& machine, const Options& options, const Volume& volume);
/// The same of the points of a field that are inside, at most 400 of them.
BeyondSingular beyond_singular(const AnyMachine& machine, const Options& options, const Field& field);

}  // namespace polypod::workspace
