// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Settling a machine of legs from a pose that it has already.
#pragma once

#include <optional>

#include "polypod/families/parallel/machine.hpp"

namespace polypod::machine {

/// As settled(), but from `start`, a pose that keeps the constraints near `target`: one run of Newton's method, so that
/// a search may ask for it at every step. Empty where that does not converge, or ends far from the start.
std::optional<Pose> settled_near(const Parallel& m, const Pose& target, const Pose& start);

/// The same legs with the tool tip at the point `v` of the tool frame: x, y and z of its poses are those of that point.
/// Without limits of the tool tip.
Parallel with_tip_at(const Parallel& m, const Vec3& v);

/// Home with the coordinates that follow, which the file need not give: up to as far off as the longest leg reaches.
/// Empty where Newton's method finds none.
std::optional<Pose> closed_home(const Parallel& m);

}  // namespace polypod::machine
