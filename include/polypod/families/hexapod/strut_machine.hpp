// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Hexapods whose six struts change their length (JEL 3.1).
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/core/config.hpp"
#include "polypod/families/hexapod/machine.hpp"

namespace polypod::machine {

/// A strut hexapod (Stewart-Gough platform): |t + R b_i - a_i| = l_i, length_min <= l_i <= length_max, with X_MP = (R,
/// t) and the tool tip T at tool_length along the platform's normal, T parallel to P (JEL (3.3), (3.4)). Joint
/// coordinates: what the controller reads, q_i = l_i - offset_i; without offsets the lengths l_i.
struct StrutHexapod : TipLimits {
  static constexpr std::string_view kFamily = "strut-hexapod";
  /// Each end of a leg has an error of its joint and one of what the joint is fixed to.
  static constexpr bool kAttachments = true;

  std::string name;
  std::string description;
  SixPoints base_joint{};                       ///< a_i in M, m
  SixPoints platform_joint{};                   ///< b_i in P, m
  std::optional<PairedCircle> base_circle;      ///< how the base was given, if not point by point
  std::optional<PairedCircle> platform_circle;  ///< the same for the platform
  double length_min = 0;                        ///< m, between the joints
  double length_max = 0;                        ///< m
  SixNumbers leg_offset{};                      ///< m, length less reading: the zeros that a calibration finds
  double leg_diameter = 0;                      ///< m, 0: thin legs that may cross
  double tool_length = 0;                       ///< m, along z_P
  JointLimit joint;                             ///< of every joint at base and platform
  JointSeats base_seats, platform_seats;        ///< with JointLimitKind::cone only
  /// Without a given height: where the struts' mean length is (length_min + length_max) / 2.
  HexapodHome home;
  double compliance = 0;        ///< m/N of a strut along its axis, the mean of the six
  SixNumbers leg_compliance{};  ///< m/N of each
  Provenance provenance;

  /// Reads the keys of a strut hexapod (docs/machine-files.md). Errors: MA120 to MA129 and those of config.
  static Result<StrutHexapod> from(const config::Table& table);
};

/// The parameters of the kinematics: leg.length[i] (zero offset of strut i), base.joint[i].x, .y, .z,
/// platform.joint[i].x, .y, .z (i from 1) and tool.length: 43 in this order, leg by leg.
std::vector<Parameter> parameters(const StrutHexapod& m);
/// Their values alone.
std::vector<double> parameter_values(const StrutHexapod& m);

/// The machine with other values of its parameters, in the order of `parameters`. Lists of joints take the place of
/// circles where they moved; a home that is not given is found anew. Errors: those of strut_hexapod_from.
Result<StrutHexapod> with_parameters(const StrutHexapod& m, std::span<const double> p);

/// What a designer changes: the keys of the machine file with their values.
std::vector<Parameter> settings(const StrutHexapod& m);

/// Writes the machine as a file that reads back to the same machine.
std::string to_toml(const StrutHexapod& m);

}  // namespace polypod::machine
