// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Writing TOML.
#pragma once

#include <string>
#include <string_view>

namespace polypod {

/// The text as a basic string of TOML 1.0, in its quotes: quotes and backslashes with a backslash before them, control
/// characters as `\uNNNN`, and U+FFFD for each byte that is not UTF-8, which no TOML file may hold. A reader gets the
/// same text back, but for these bytes. Cost: linear.
std::string quoted_toml(std::string_view text);

}  // namespace polypod
