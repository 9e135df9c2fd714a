// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Deltas whose chains are driven by carriages on straight rails (towers).
#pragma once

#include <span>
#include <string_view>

#include "polypod/core/config.hpp"
#include "polypod/families/delta/machine.hpp"

namespace polypod::machine {

/// A linear delta: S_i = a_i + q_i u_i with 0 <= q_i <= rail length. Joint coordinates: q_i, m.
struct LinearDelta : Delta {
  static constexpr std::string_view kFamily = "linear-delta";

  PerArm<Vec3> rail_start{};      ///< a_i in M, m
  PerArm<Vec3> rail_direction{};  ///< u_i, unit
  std::optional<SymmetricDelta> symmetric;
  double incline = 0;  ///< rad, of symmetric rails from z towards the axis

  /// Reads the keys of a linear delta (docs/delta.md). Errors: MA140 to MA149 and those of config.
  static Result<LinearDelta> from(const config::Table& table);
};

/// Rail by rail: rail.start[i].x, .y, .z, rail.direction[i].x, .y, .z, rod.length[i], platform.joint[i].x, .y, .z; then
/// tool.x, .y, .z.
std::vector<Parameter> parameters(const LinearDelta& m);
/// Their values alone.
std::vector<double> parameter_values(const LinearDelta& m);
/// What a designer changes: the keys of the machine file with their values.
std::vector<Parameter> settings(const LinearDelta& m);
std::string to_toml(const LinearDelta& m);
/// The machine with other values of `parameters`; one that is no longer symmetric is written chain by chain. Errors:
/// those of the reader.
Result<LinearDelta> with_parameters(const LinearDelta& m, std::span<const double> p);

}  // namespace polypod::machine
