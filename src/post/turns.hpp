// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Rotary angles of a tool axis.
#pragma once

#include <array>

#include "polypod/post/plan.hpp"

namespace polypod::post {

/// The two pairs of rotary angles that point the tool along k, each in the turn nearest to `last`; at a pole the free
/// angle is that of `last`. `c` is C of Rotary::abc.
std::array<Vec3, 2> both_turns(Rotary rotary, const Vec3& k, double c, const Vec3& last);
/// The one of the two whose largest change is smaller; the first where both are equal.
Vec3 nearest_turn(Rotary rotary, const Vec3& k, double c, const Vec3& last);
/// On the shortest way from k_0 to k_1 (not opposite), s = 0..1.
Vec3 between_axes(const Vec3& k_0, const Vec3& k_1, double s);

}  // namespace polypod::post
