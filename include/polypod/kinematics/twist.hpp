// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The turn of the platform about the tool axis as a free choice: a cutter does not care.
#pragma once

#include <optional>
#include <vector>

#include "polypod/kinematics/any_machine.hpp"

namespace polypod::kinematics {

/// from <= twist <= to, rad, from in [-pi, pi); to may lie beyond pi where the range runs across the half turn.
struct TwistRange {
  double from = 0, to = 0;
};

/// The angles gamma for which the pose (R R_z(gamma), p) has a solution that keeps all limits, in rising order; one
/// range of a full turn where every angle does. The ends are bisected to 1e-9 rad between samples of `step` rad: a
/// range or a gap narrower than that may be missed. For a machine whose task leaves a coordinate free, to which the
/// twist is nothing, the full turn or nothing. Cost: 2 pi / step inverse solutions, and 25 an end.
std::vector<TwistRange> twist_ranges(const AnyMachine& machine, const Pose& X_MT, double step = 0.01);

/// X turned about its tool axis.
Pose twisted(const Pose& X_MT, double gamma);

/// The angle of least |gamma| within the ranges: 0 if that works, else `margin` rad (at most half the range) inside the
/// nearest end. Empty: no angle works.
std::optional<double> nearest_twist(const std::vector<TwistRange>& ranges, double margin = 0.01);

}  // namespace polypod::kinematics
