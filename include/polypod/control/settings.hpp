// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A machine in the words of a controller: the parameters that LinuxCNC's and Klipper's own kinematics take.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "polypod/machine/any_machine.hpp"

namespace polypod::control {

using machine::AnyMachine;

enum class Controller { linuxcnc, klipper };

/// One line of a controller's files. `section` is "HAL" (a pin, written as `setp key value`) or the section of an INI
/// or printer.cfg file. A value is a number in the unit of the controller or, where `text` is not empty, a text.
struct Setting {
  std::string section, key;
  double value = 0;
  std::string text;
};

/// How far the real tool misses the asked points, m, over poses within all limits.
struct Misses {
  double rms = 0, max = 0, median = 0;
};

struct SettingsOptions {
  std::size_t points = 400;  ///< stands to fit to, and as many others to judge by
  std::uint64_t seed = 1;
  /// Fitted settings (of deltas): a pose counts in inverse proportion to its condition, so that those near singular
  /// ones, where every error grows, do not decide.
  bool weight_by_condition = false;
};

/// A program point p (in {F}, see below) goes to the controller's p_C = R_z(work_rotation) p + work_offset.
struct Settings {
  Controller controller = Controller::linuxcnc;
  std::string machine, module;  ///< LinuxCNC's module, or Klipper's kinematics
  std::vector<Setting> settings;
  bool exact = false;         ///< the module stands for this machine to rounding
  Misses before, after;       ///< of positions, with mean values and with these settings; `before` only where fitted
  double angle_after = 0;     ///< rad, the largest turn of the tool that is left; 0 for deltas
  std::size_t points = 0;     ///< that `before` and `after` are over
  bool fitted = false;        ///< chosen by least squares, since the module has too few parameters
  Vec3 work_offset{0, 0, 0};  ///< m
  double work_rotation = 0;   ///< rad
  std::vector<std::string> notes;  ///< what a person must know or do besides
};

/// The settings with which the controller's own kinematics come closest to this machine.
///
/// - Strut hexapods, LinuxCNC genhexkins: exact. Its joints are lengths between the joints, q + offset; its platform's
///   origin is the tool tip.
/// - Serial arms of five or six turning joints, LinuxCNC genserkins: exact. Each constant motion between two axes is
///   K = R_z(gamma) T_z(delta) T_x(a) R_x(alpha) R_z(theta) T_z(d) (Craig 1986, 3.4); gamma and delta go to the joint
///   before, theta and d to the one after. Five joints get a sixth without a motor about the tool axis, which takes the
///   C of the program; with six, a tool beside axis 6 is left out and its miss is said.
/// - Deltas of three chains, LinuxCNC lineardeltakins and rotarydeltakins, Klipper delta and rotary_delta: least
///   squares over the misses p_controller(q) - p_C(q) at random stands (Levenberg-Marquardt, Ceres), judged at others.
///   Home offsets, endstop positions and the work offset are fitted, too.
///
/// {F} is {M} for hexapods and arms. A delta's M has z downwards: {F} is M turned by half a turn about x, for Klipper
/// with z = 0 at the table (or the largest z). Errors: CN101 (no module of this controller for the machine), CN102 (an
/// arm that genserkins cannot stand for), CN103 (a delta that the model cannot start from), CN104 (too few poses
/// found), CN105 (the fit does not converge). Cost: 20 ms for deltas, 5 ms for arms.
Result<Settings> settings_for(const AnyMachine& machine, Controller controller, const SettingsOptions& options = {});

/// The settings to be pasted: for LinuxCNC a part for the HAL file, one for the INI file and a line of MDI; for Klipper
/// sections of printer.cfg. Notes and misses stand before them as remarks.
std::string text_of(const Settings& settings);

}  // namespace polypod::control
