// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Text that comes from files and arguments, made safe for the place where it is shown.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace polypod {

/// The text on one line, with nothing in it that a terminal or a reader of lines acts on.
///
/// Each byte of a control character (below 0x20, 0x7f, U+0080 to U+009F), of the marks that break lines or turn the
/// direction of writing (U+2028, U+2029, U+202A to U+202E, U+2066 to U+2069) and of what is not UTF-8 becomes `\xNN`;
/// everything else stays as it is. Text without such bytes comes back unchanged, and so does a text that went through
/// once. Cost: linear.
std::string one_line(std::string_view text);

/// "x", "x and y", "x, y and z".
std::string listed(const std::vector<std::string>& words);

}  // namespace polypod
