// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Rotary angles of a tool axis, and the C that suits a program best.
#pragma once

#include <vector>

#include "polypod/kinematics/any_machine.hpp"
#include "polypod/post/plan.hpp"

namespace polypod::post {

/// The two pairs of rotary angles that point the tool along k, each in the turn nearest to `last`; at a pole the free
/// angle is that of `last`. `c` is C of Rotary::abc.
std::array<Vec3, 2> both_turns(Rotary rotary, const Vec3& k, double c, const Vec3& last);
/// The one of the two whose largest change is smaller; the first where both are equal.
Vec3 nearest_turn(Rotary rotary, const Vec3& k, double c, const Vec3& last);
/// On the shortest way from k_0 to k_1 (not opposite), s = 0..1.
Vec3 between_axes(const Vec3& k_0, const Vec3& k_1, double s);

/// C at the end of each step (of steps that do not move: that before it) so that the arm stays in the posture `branch`
/// within its limits, by dynamic programming over values 5 deg apart: the sum of the squares of the joints' changes,
/// and of how near each joint is to its limits, is smallest. Empty where no such way was found.
std::vector<double> choose_c(const Configuration& configuration, const Path& path, const PlanOptions& options,
                             unsigned branch, double first_c);

}  // namespace polypod::post
