// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Paths and masses from tables that are read already, as part of another file.
#pragma once

#include "polypod/core/config.hpp"
#include "polypod/motion/dynamics.hpp"
#include "polypod/motion/pose_path.hpp"

namespace polypod::motion {

/// The masses of a table with the keys of `dynamics`. Errors: those of read_dynamics.
Result<Dynamics> dynamics_from(const config::Table& table, const AnyMachine& machine);

/// The path of a table with the keys of a path file in TOML; it may hold others that were asked for already. Errors:
/// those of read_pose_path.
Result<PosePathFile> pose_path_from(const config::Table& table);

}  // namespace polypod::motion
