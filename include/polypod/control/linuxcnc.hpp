// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A machine as a configuration of LinuxCNC: a kinematics module of its own in C, INI, HAL, tool table.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "polypod/machine/any_machine.hpp"

namespace polypod::control {

using machine::AnyMachine;
using machine::JointVector;

/// One of the module's parameters, as a pin of HAL; its value in mm, deg or without a unit.
struct ModulePin {
  std::string name;  ///< without the module's: "leg.length.1"
  double value = 0;
};

/// A kinematics module for LinuxCNC.
///
/// It is one file of C that needs nothing but LinuxCNC's headers, allocates nothing after it is loaded, and keeps
/// nothing between two calls but figures that follow from its pins.
/// - Legs and constraints: the inverse in closed form, in the working mode of the pins `high-N` (N the joint, for
///   drives with two positions); coordinates that no pose prescribes by Newton's method from home, in steps along the
///   straight line of the coordinates where one would be long. Forward by Newton's method from the pose that LinuxCNC
///   hands over, else from home by joints between; only poses in home's assembly mode (sign of det F_X) and working
///   mode count.
/// - Serial chains, and chains before and behind a stage with closed loops: forward by the chain; inverse by Newton's
///   method from the joints that LinuxCNC hands over, in steps where one would be long, never through a singular pose,
///   so in the posture of those joints.
/// With a force the inverse takes the joints of the pose shifted by C F, C the compliance of the tip at the pose, so
/// that the deflected tip is where it is commanded; the forward takes the same shift away, so that nothing drifts
/// (SLAV 3.4). What does not converge, is not finite or would change the mode returns -1, counts in `inverse-failures`
/// or `forward-failures` and sets `kinematics-error` until a call succeeds.
struct Module {
  std::string name;    ///< of the module and its component: "hexapod_strut_kins"
  std::string source;  ///< C
  std::vector<ModulePin> pins;
  /// What deflects under the pins force-x, -y, -z (N, in M): "compliance.1", um/N along a line, rad/Nm about an axis.
  /// Empty where the machine has no compliances, or more equations than six.
  std::vector<ModulePin> compliances;
};

/// The module of the machine that stands at the joints `home`. Errors: LC101 (a family without a module), LC102 (joints
/// and coordinates differ in number), LC103 (home is no pose of the machine).
Result<Module> linuxcnc_module(const AnyMachine& machine, const JointVector& home);

struct ForceLoop;

struct LinuxcncOptions {
  std::optional<JointVector> home;  ///< rad or m; empty: the machine's own home, of arms a pose with room around it
  double slide_speed = 0.2;         ///< m/s, of drives along a line, at most
  double turn_speed = 1.5707963267948966;  ///< rad/s, of drives that turn, at most
  double time_to_speed = 0.1;              ///< s, from standstill to full speed
  std::size_t stands = 1000;               ///< over which limits and speeds are taken
  /// On-line correction (force_loop.hpp) of the machine of this configuration; must outlive the call.
  const ForceLoop* force = nullptr;
};

/// A range of an axis or a joint, mm or deg, with what it may do in a second.
struct ControllerAxis {
  char letter = 'X';  ///< 'J' for joints
  bool turns = false;
  double min = 0, max = 0, speed = 0, acceleration = 0, home = 0;
};

struct LinuxcncConfiguration {
  struct File {
    std::string name, text;
  };
  Module module;
  std::vector<File> files;  ///< NAME.ini, NAME.hal, NAME.tbl, MODULE.c, machine.toml, example.ngc; with `force` also
                            ///< NAME_force.comp, NAME_cut.comp, corrected.ngc
  std::vector<ControllerAxis> axes, joints;
  std::size_t stands = 0;  ///< that the axes' limits and speeds are over
  std::vector<std::string> notes;
};

/// Everything that LinuxCNC needs to run the machine in simulation: its own module, joints with the machine's ranges
/// and homes, axes with the bounds and speeds found at random stands within all limits on home's side of singular poses
/// (a sample: they bound nothing outside it), [TRAJ]HOME = forward(homes), drives that follow at once, an e-stop that
/// `kinematics-error` opens. Deterministic. Errors: those of linuxcnc_module; LC104 (no stand was found); LC132 (with
/// `force`: a machine without compliances, or whose poses leave out x, y or z). Cost: some seconds.
Result<LinuxcncConfiguration> linuxcnc_configuration(const AnyMachine& machine, const LinuxcncOptions& options = {});

}  // namespace polypod::control
