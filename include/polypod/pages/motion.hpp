// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Table and page of a motion of a delta (KOZ Figures 4-13 to 4-15).
#pragma once

#include <string>

#include "polypod/motion/delta_motion.hpp"

namespace polypod::pages {

/// A row a sample: t_s, x_mm, y_mm, z_mm, their derivatives, then each drive with its three derivatives (deg or mm);
/// drives are empty where the tool is out of reach.
std::string motion_csv(const machine::AnyMachine& machine, const motion::Run& run);

/// One self-contained HTML file: the answer, curves of position, speed, acceleration and jerk of tool and drives over
/// time, the way in space beside the machine at home with problems in red, a table of the peaks. The same input gives
/// the same bytes. `version` of Polypod, or empty.
std::string motion_page(const machine::AnyMachine& machine, const motion::Run& run, const std::string& what,
                        const std::string& version);

}  // namespace polypod::pages
