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

struct ChosenTurns {
  std::vector<double> c;  ///< of each step, rad; empty where no such way was found
  double cost = 0;
  std::size_t blocked = 0;  ///< then the first step that no way reaches
};
/// C at the end of each step (of steps that do not move: that before it) so that the arm stays in the posture `branch`
/// within its limits and, where they are given, its joints' speeds: the cheapest way on a ladder of 72 values, 5 deg
/// apart, by at most 30 deg from one point to the next (cheapest_way). A state costs as its joints come near to their
/// limits, as the pose is near to a singular one (det J), as it is soft across the path (compliances of the file) and,
/// at the first point, as it is far from `start_joints`; a step costs the squares of the joints' changes and of their
/// shares of the speed limits. For arms with six joints and a closed inverse. Cost: 1 us a value and point.
ChosenTurns choose_c(const Configuration& configuration, const Path& path, const PlanOptions& options, unsigned branch,
                     double first_c);

/// What states cost in this posture at 64 points of the path, at their best of 24 values of C: which posture to try
/// first. Infinite where one of the points cannot be reached in it.
double first_look(const Configuration& configuration, const Path& path, const PlanOptions& options, unsigned branch);

}  // namespace polypod::post
