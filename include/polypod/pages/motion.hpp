// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Tables and pages of motions (KOZ Figures 4-13 to 4-15, JEL Figures 7.1 to 7.4).
#pragma once

#include <string>

#include "polypod/motion/cycles.hpp"
#include "polypod/motion/machine_motion.hpp"

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

/// The kinds of limits that a machine has at every pose, in words: "ranges of the drives", "table", ...
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

/// The same for any machine: t_s, line, x_mm, y_mm, z_mm, a_deg, b_deg, c_deg, the tip's derivatives, those of the
/// drives, the condition number, the limit that is met the nearest with its share, and what is broken. Cells that are
/// not known are empty.
std::string move_csv(const machine::AnyMachine& machine, const motion::MoveResult& run);

/// One self-contained HTML file: the answer, the path beside the machine at its start, at its end and where something
/// is broken first (what breaks a limit is red), curves over time, limits, peaks.
std::string move_page(const machine::AnyMachine& machine, const motion::PosePath& path, const motion::MoveResult& run,
                      const MotionQuestion& question, const std::string& version, const std::string& command = {});

}  // namespace polypod::pages
