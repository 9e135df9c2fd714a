// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Machines in series: each stage is a machine of its own that carries the next one.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/core/config.hpp"
#include "polypod/machine/common.hpp"

namespace polypod::machine {

class AnyMachine;

/// What a stage has of the joints and parameters of the whole, and how it is mounted.
struct StageData {
  Pose mount;        ///< the stage's {M} in the tool frame of the stage that carries it; of the first one in {M}
  JointVector home;  ///< of a stage that is a serial chain, rad or m; else empty: its own home counts
  int joints = 0;
  int parameters = 0;  ///< its machine's own, without those of the mount
};

/// Machines in series: X_MT = X_1 Y_1 X_2 Y_2 ..., X_k the mount of stage k and Y_k the pose of its tool in its own M.
/// At most one stage has closed loops; all others are serial chains. The joints are those of the stages one after the
/// other, as many as the task has coordinates.
struct Stages : TipLimits {
  static constexpr std::string_view kFamily = "stages";
  /// A pose may be taken in any posture of the chains.
  static constexpr bool kAnyPosture = true;

  std::string name;
  std::string description;
  Task task;
  std::vector<AnyMachine> machines;
  std::vector<StageData> data;  ///< of each machine
  std::size_t closed = 0;       ///< the stage with closed loops; the last one if there is none
  Provenance provenance;

  /// Errors: MA160 (a stage in a stage, a second stage with closed loops), MA161 (joints and task differ), MA162 (home
  /// of a stage), and those of the stages' own readers.
  static Result<Stages> from(const config::Table& table);
};

/// `stage[k].mount.x`, .y, .z, .a, .b, .c of each stage but the first; its machine's own as `stage[k].machine.KEY`.
std::vector<Parameter> parameters(const Stages& m);
/// The stages' own settings as `stage[k].machine.KEY`; limits of the tool tip.
std::vector<Parameter> settings(const Stages& m);
std::string to_toml(const Stages& m);
/// The machine with other values of `parameters`. Errors: those of the stages' readers.
Result<Stages> with_parameters(const Stages& m, std::span<const double> p);

}  // namespace polypod::machine
