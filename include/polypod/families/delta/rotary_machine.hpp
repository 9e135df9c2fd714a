// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Deltas whose chains are driven by turning arms (KOZ chapter 4).
#pragma once

#include <span>
#include <string_view>

#include "polypod/core/config.hpp"
#include "polypod/families/delta/machine.hpp"

namespace polypod::machine {

/// A delta with arms: S_i = Q_i + d_i (sin(theta) outward_i - cos(theta) z), theta = q_i + zero_i: 0 points up (away
/// from the platform), 90 deg outward, 180 deg down (KOZ (4.31) to (4.33)). Joint coordinates: q_i, rad.
struct RotaryDelta : Delta {
  static constexpr std::string_view kFamily = "rotary-delta";

  PerArm<Vec3> base_joint{};    ///< Q_i in M, m
  PerArm<double> arm_length{};  ///< d_i, m
  PerArm<double> zero{};        ///< rad
  std::optional<SymmetricDelta> symmetric;

  /// Reads the keys of a rotary delta (docs/delta.md). Errors: MA140 to MA149 and those of config.
  static Result<RotaryDelta> from(const config::Table& table);
};

/// The parameters of the kinematics, arm by arm: base.joint[i].x, .y, .z, arm.direction[i], arm.length[i],
/// drive.zero[i], rod.length[i], platform.joint[i].x, .y, .z; then tool.x, .y, .z.
std::vector<Parameter> parameters(const RotaryDelta& m);
/// Their values alone.
std::vector<double> parameter_values(const RotaryDelta& m);
/// What a designer changes: the keys of the machine file with their values.
std::vector<Parameter> settings(const RotaryDelta& m);
std::string to_toml(const RotaryDelta& m);
/// The machine with other values of `parameters`; one that is no longer symmetric is written chain by chain. Errors:
/// those of the reader.
Result<RotaryDelta> with_parameters(const RotaryDelta& m, std::span<const double> p);

}  // namespace polypod::machine
