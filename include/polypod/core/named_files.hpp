// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

namespace polypod::config {

/// The files that a TOML file names, and those that they name: every text in it that is the name of a file beside it
/// (or an absolute one). A job names its machine, cutters, material, stock and measured displacements so, whatever the
/// keys are called; what is written must not replace them. Empty if the file cannot be read. Cost: reads each of the
/// TOML files once.
std::vector<std::string> files_named_by(const std::string& path);

}  // namespace polypod::config
