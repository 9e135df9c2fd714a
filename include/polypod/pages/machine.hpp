// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A machine by itself: the page that `polypod view` shows, and what it asks while a figure is changed.
#pragma once

#include <string>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/machine/any_machine.hpp"
#include "polypod/report/scene.hpp"
#include "polypod/workspace/volume.hpp"

namespace polypod::pages {

/// A machine at one pose.
struct MachineAt {
  Pose X;                               ///< the whole pose that it takes
  machine::JointVector q;               ///< rad or m
  std::vector<std::string> violations;  ///< limits that it breaks there
  std::string reason;                   ///< why it takes no such pose; `lines` are empty then
  std::vector<report::Line3> lines;     ///< M, mm
  double condition = 0, sigma_min = 0;  ///< as kinematics::dexterity
};
/// At what the task prescribes of X: the solution within the limits, or else the first one. Cost: one inverse.
MachineAt machine_at(const machine::AnyMachine& machine, const Pose& X);
/// At the joints q: the pose that `forward` reaches from home.
MachineAt machine_at(const machine::AnyMachine& machine, const machine::JointVector& q);
/// Where a page begins: home, or the tool with R = 1 at the middle of the work where there is no home; where that is
/// out of reach, the best conditioned of some places near the middle of the joints' ranges that keep all limits.
Pose start_pose(const machine::AnyMachine& machine);

/// The machine at `at`, and the boundary of its workspace coloured by the limits that make it (surface() with
/// `resolution` points). Errors: those of surface().
Result<report::Scene> workspace_scene(const machine::AnyMachine& machine, const workspace::Options& options,
                                      const MachineAt& at, int resolution);
/// What is reached of the coordinates of a task without x, y, z, in sentences.
std::string region_in_words(const machine::AnyMachine& machine, const workspace::Options& options,
                            const workspace::Volume& region);
/// The machine at `at` alone.
report::Scene machine_scene(const machine::AnyMachine& machine, const MachineAt& at);
/// Whether pictures of the machine are turned so that it hangs from its base.
bool hangs(const machine::AnyMachine& machine);

struct MachinePageOptions {
  std::string version;  ///< of Polypod; default: not named
  std::string live;     ///< JSON for the page's script, where a server answers it; empty: a page for itself
};
/// One HTML file: the machine at its start with sliders for pose and joints, its figures, where they come from.
std::string machine_page(const machine::AnyMachine& machine, const MachinePageOptions& options = {});

}  // namespace polypod::pages
