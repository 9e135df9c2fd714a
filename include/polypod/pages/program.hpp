// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A program by itself, without a machine and without a job.
#pragma once

#include <string>

#include "polypod/gcode/unroll.hpp"
#include "polypod/geometry/pose.hpp"

namespace polypod::pages {

/// What the moves of a program say by themselves. Moves whose start is not known do not count but in `unknown`.
struct ProgramFigures {
  std::size_t feeds = 0, rapids = 0, unknown = 0;
  double feed_length = 0, rapid_length = 0;              ///< m
  double feed_time = 0;                                  ///< s, at the programmed feeds, without acceleration
  std::size_t without_feed = 0;                          ///< feeds whose F is not known: they have no time
  double least_feed = 0, largest_feed = 0;               ///< m/s; 0: none
  Vec3 low = Vec3::Zero(), high = Vec3::Zero();          ///< m, the box of all feeds, in W
  Vec3 low_all = Vec3::Zero(), high_all = Vec3::Zero();  ///< the same with the rapids
  bool turns = false;                                    ///< A, B or C move
};
/// Arcs count with the extremes between their ends. Cost: linear.
ProgramFigures figures_of(const LongVector<gcode::Move>& moves);

/// One HTML file: the path in space with the feeds as colours, its length, its box, times at the programmed feeds, and
/// the lines that run; a line that is picked shows in the path. `version`: of Polypod; may be empty.
std::string program_page(const gcode::Understood& program, const std::string& version);

}  // namespace polypod::pages
