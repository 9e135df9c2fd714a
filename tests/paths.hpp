// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Where the files that tests read stand.
#pragma once

#include <string>

namespace polypod::test {

/// The path of a file of the source tree: source("machines/lola50.toml").
std::string source(const std::string& file);

}  // namespace polypod::test
