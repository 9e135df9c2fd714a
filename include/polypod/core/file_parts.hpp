// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Files that are read part by part.
#pragma once

#include <functional>
#include <string>
#include <string_view>

#include "polypod/core/error.hpp"

namespace polypod::files {

/// Calls `take` with the bytes of a file (`-`: standard input), some at a time. Errors: those of `read`, and those of
/// `take`, which end it.
Status read_parts(const std::string& path, const std::function<Status(std::string_view)>& take);

}  // namespace polypod::files
