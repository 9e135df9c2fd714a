// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A table of a TOML file as text again.
#pragma once

#include <string>

namespace polypod::config {

/// The top table of this key in a TOML file, under its own heading, with the same values (comments do not stay). Empty
/// where there is none, or the file cannot be read or is no TOML file: its reader says that.
std::string table_text(const std::string& path, const std::string& key);

}  // namespace polypod::config
