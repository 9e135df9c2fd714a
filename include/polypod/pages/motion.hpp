// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Table and page of a motion of a delta (KOZ Figures 4-13 to 4-15).
#pragma once

#include <string>

#include "polypod/motion/delta_motion.hpp"

namespace polypod::pages {

/// A limit of a motion and how near the motion comes to it.
struct MotionLimit {
  std::string name;  ///< "speed of the tool"
  double limit = 0;  ///< in `unit`
  double met = 0;    ///< the largest value that was met (of a distance: the least), in `unit`
  std::string unit;
  bool given = false;  ///< by the user; otherwise assumed
};
/// What the motion was judged by, and what it was not judged by.
struct MotionQuestion {
  std::string what;  ///< the title
  std::vector<MotionLimit> limits;
  std::vector<std::string> judged, not_judged;  ///< kinds of limits in words
};

/// The kinds of limits that a delta has at every pose, in words: "ranges of the drives", "table", ...
std::vector<std::string> limits_of_poses(const machine::AnyMachine& machine);

/// A row a sample: t_s, x_mm, y_mm, z_mm, their derivatives, then each drive with its three derivatives (deg or mm);
/// drives are empty where the tool is out of reach.
std::string motion_csv(const machine::AnyMachine& machine, const motion::Run& run);

/// One self-contained HTML file: the answer, curves of position, speed, acceleration and jerk of tool and drives over
/// time, the way in space beside the machine at home with problems in red, the limits (given or assumed) beside what
/// was met, a table of the peaks. The same input gives the same bytes. `version` of Polypod and the command line that
/// makes the page again, or empty.
std::string motion_page(const machine::AnyMachine& machine, const motion::Run& run, const MotionQuestion& question,
                        const std::string& version, const std::string& command = {});

}  // namespace polypod::pages
