// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Files appear whole or not at all.
#pragma once

#include <string>
#include <string_view>

#include "polypod/core/error.hpp"

namespace polypod::files {

/// The bytes of a file. Errors: FI100 (not there, a directory, unreadable).
Result<std::string> read(const std::string& path);

/// Writes `bytes` under `path` by way of a temporary file beside it and a rename, so that `path` is either the old file
/// or the whole new one. Errors: FI101 (a directory, no such folder, no permission, disk full).
Status write_whole(const std::string& path, std::string_view bytes);

/// Whether write_whole could write here, as far as can be told beforehand: the folder is there, and `path` is none.
/// Long work asks first. Errors: FI101.
Status may_write(const std::string& path);

/// Removes the temporary files that are open now; safe in a signal handler. For handlers of signals that end the
/// program.
void remove_temporaries() noexcept;

}  // namespace polypod::files
