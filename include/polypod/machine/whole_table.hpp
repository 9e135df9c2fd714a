// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A machine file as a table, before a machine is made of it.
#pragma once

#include <string>

#include "polypod/core/config.hpp"

namespace polypod::machine {

/// The table of a machine file (TOML or URDF); stages that name their machine hold its table instead. Errors: those of
/// config, MA100.
Result<config::Table> whole_table(const std::string& path);

}  // namespace polypod::machine
