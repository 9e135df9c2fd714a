// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// On-line correction by a force sensor in LinuxCNC itself: two realtime components beside the kinematics module.
#pragma once

#include <string>
#include <vector>

#include "polypod/control/online.hpp"

namespace polypod::control {

/// The force of the cut at a place of the programmed path, linear about it: at the feed v, with the tip `e` beside the
/// path, to the left of it, and its way turned to the left by de/dt / v,
///   F = edge + v chip + e (edge_off + v chip_off) + (de/dt / v) (edge_turned + v chip_turned).  In M.
struct PathForce {
  Vec3 p_M = Vec3::Zero();          ///< m
  bool ends = false;                ///< the move ends here: nothing between it and the next place
  Vec3 edge = Vec3::Zero();         ///< N
  Vec3 chip = Vec3::Zero();         ///< N s/m
  Vec3 edge_off = Vec3::Zero();     ///< N/m
  Vec3 chip_off = Vec3::Zero();     ///< N s/m^2
  Vec3 edge_turned = Vec3::Zero();  ///< N a rad
  Vec3 chip_turned = Vec3::Zero();  ///< N s/m a rad
  Vec3 corrected = Vec3::Zero();    ///< N, that the corrected program is made for
};

struct ForceLoop {
  OnlineMethod method = OnlineMethod::both;
  OnlineOptions options;
  std::vector<PathForce> path;
  std::string corrected;  ///< the corrected program
  std::string answer;     ///< what machining::correct says of it, for the job's own forces
  OnlineLoop loop;        ///< the worst that the cut without correction showed
  OnlineMargin margin;    ///< with what LinuxCNC adds to the delay
  std::vector<std::string> not_judged;
};

/// LinuxCNC has the joints two cycles after the command (record.hpp).
inline constexpr double kLinuxcncDelay = 2e-3;  // s

/// Everything that the configuration of one machine needs for a loop with this job and program, and whether it may run:
/// the margin is that of look_online, with kLinuxcncDelay more.
///
/// The path's force is that of the cutter on the programmed path, every 0.5 mm (4000 places at most), the stock cut
/// along the path; beside it by two more cutters that go 0.3 mm to each side of it all the way, and turned by
/// differences over 0.2 rad. Left out: the force of plunges, and a cutter that turns in full material.
///
/// Errors: LC131 the margin is less than options.least_margin (the hint says which low-pass and which delay would do;
/// not with the methods none and offline), LC132 a job that the loop does not know: a tilted tool, a ball, a measured
/// compliance; those of machining::correct and look_online. Cost: that of both.
Result<ForceLoop> force_loop(const machining::Job& job, const gcode::Program& program,
                             const gcode::Interpretation& interpretation, const OnlineOptions& options,
                             OnlineMethod method);

/// The components, for halcompile. `name`: of the machine, as in the module's without _kins.
std::string force_component(const std::string& name);
std::string cut_component(const std::string& name, const ForceLoop& loop);

}  // namespace polypod::control
