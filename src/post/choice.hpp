// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// C and the place of the external axis that suit a program best.
#pragma once

#include <cstddef>
#include <vector>

#include "polypod/post/plan.hpp"

namespace polypod::post {

struct Choice {
  std::vector<double> c;         ///< of each step, rad; empty where C is not chosen, or no such way was found
  std::vector<double> external;  ///< of each step, rad or m; the same of the external axis
  bool found = false;
  std::size_t blocked = 0;  ///< where none was found: the first step that no way reaches
};

struct ChoiceQuestion {
  unsigned branch = 0;  ///< of the closed inverse
  int turn = 0;         ///< where C is given: which of the two pairs of rotary angles it begins with (both_turns)
  /// Whether the ladder has its rungs at every point; else where the tip has gone 1/200 of the sum of links or the tool
  /// axis has turned by 5 deg since the last, and at the ends of rapids, and linearly between.
  bool every_point = false;
  /// A value of C at the end of a step of the path with which the plan had a problem there: neither it nor one within
  /// 12 deg of it is taken again.
  struct Avoided {
    std::size_t step = 0;
    double c = 0;  ///< rad
  };
  std::vector<Avoided> avoided = {};
};

/// What `options` leave open, C or the external axis or both, at the end of each step (of steps that do not move: that
/// before it), so that the arm stays in the posture within its limits and, where they are given, its joints' speeds:
/// the cheapest way on a ladder (cheapest_way) of 72 values of C, 5 deg apart, of which one changes by at most 30 deg
/// from rung to rung, or of 65 places of the external axis. Of both, the cheapest way over 36 times 17 of them, then
/// over 65 places with that C, then over 72 values of C with these places. At last each alone beside what was found, at
/// 33 values an eighth of a step apart. A state costs as its joints come near to
/// their limits, as the pose is near to a singular one (det J), as it is soft across the path (compliances of the file)
/// and, at the first point, as it is far from `start_joints`; a step costs the squares of the joints' changes and of
/// their shares of the speed limits. For arms of six joints with a closed inverse, on an external axis or not. Cost: 1
/// us a state.
Choice choose(const Configuration& configuration, const Path& path, const PlanOptions& options,
              const ChoiceQuestion& question);

/// What states cost in this posture at 64 points of the path, at the best of 24 values of C and 9 places: which posture
/// to try first. Infinite where one of the points cannot be reached in it.
double first_look(const Configuration& configuration, const Path& path, const PlanOptions& options,
                  const ChoiceQuestion& question);

}  // namespace polypod::post
