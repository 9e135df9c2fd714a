// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the controller makes of a way at its corners, and the path control mode that a tolerance needs.
#pragma once

#include <vector>

#include "polypod/machining/path_mode.hpp"
#include "way.hpp"

namespace polypod::machining {

/// The corners of a way with the distances that they add to.
struct Corners {
  LongVector<double> deviation;  ///< m, of each commanded move: the larger of its two ends; 0 where it does not cut
  LongVector<double> with;       ///< m, largest distance of each commanded move with its corners
  LongVector<double> slack;      ///< m, at the joint after each move: what the tube leaves; infinite in the air
  std::vector<int> breaking;     ///< blocks whose path control word is in force at a joint that is rounded too much
  double largest = 0;            ///< m, deviation at a cut
  double largest_with = 0;       ///< m, distance with corners
  int line = 0;                  ///< of the program, where that is; 0 where nothing cuts
  double time = 0;               ///< s
  SlowCorners slow;              ///< where it is slower than the feed
  bool kept = true;              ///< no joint is rounded by more than its slack
};

/// Joint deviations of `way` under the modes in force (see corners), on top of the distances of `prediction`, of which
/// none may exceed `inside` (m). A joint counts at both moves that meet there, if they cut.
///
/// `before`: the distances with corners of the programmed moves as they are. A move that is outside all the same keeps
/// its corners to what it was before.
Corners corners_of(const Job& job, const gcode::Program& program, const Way& way, const Prediction& prediction,
                   double inside, const LongVector<double>* before = nullptr);

/// The mode that keeps every joint that can be kept.
PathModeChoice mode_for(const Job& job, const Way& way, const Corners& corners);

}  // namespace polypod::machining
