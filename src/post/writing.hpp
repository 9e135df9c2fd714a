// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the writers share.
#pragma once

#include <string>
#include <string_view>

#include "polypod/gcode/writer.hpp"
#include "polypod/post/write.hpp"

namespace polypod::post {

/// m: a move that is shorter only turns.
inline constexpr double kNoWay = 1e-9;

using gcode::number;
/// Printable ASCII on one line, cut off.
std::string plain_text(std::string_view text, std::size_t longest);

Result<Written> write_robot(Dialect dialect, const Configuration& configuration, const Path& path, const Plan& plan,
                            const WriteOptions& options);

}  // namespace polypod::post
