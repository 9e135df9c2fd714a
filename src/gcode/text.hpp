// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Characters of a program, as LinuxCNC's interpreter takes them.
#pragma once

#include <algorithm>
#include <cstddef>
#include <string_view>

namespace polypod::gcode {

/// LinuxCNC refuses longer lines, characters.
inline constexpr std::size_t kLongestLine = 252;

inline char upper(char c) {
  return c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
}
inline bool is_space(char c) {
  return c == ' ' || c == '\t' || c == '\r';
}

/// Without the blanks in front.
inline std::string_view from_first_word(std::string_view text) {
  while (!text.empty() && is_space(text.front())) text.remove_prefix(1);
  return text;
}
/// Whether the text begins with a word that is given in capitals, in whatever case it is written.
inline bool begins_with(std::string_view text, std::string_view word) {
  return text.size() >= word.size() &&
         std::equal(word.begin(), word.end(), text.begin(), [](char a, char b) { return upper(b) == a; });
}

/// Whether a line is one of '%' alone, as LinuxCNC wants it.
inline bool is_percent(std::string_view text) {
  text = from_first_word(text);
  return text.starts_with('%') && from_first_word(text.substr(1)).empty();
}

/// What is said of an O that is not the first word of its line, and of what stands behind one that calls nothing.
inline constexpr const char* kOWithin = "O within a block; O words stand at the start of their line";
inline constexpr const char* kOWithinHint = "is the digit 0 meant?";
inline constexpr const char* kBehindO = "behind an O word that is no sub, call, if, while, ...";
inline constexpr const char* kBehindOHint = "move it to a line of its own";

/// What is said of a `*` outside of brackets.
inline constexpr const char* kStar = "'*' outside of brackets: LinuxCNC reads no checksum";
inline constexpr const char* kStarHint = "remove a checksum; a product stands in brackets: #2=[#1*2]";

/// Whether LinuxCNC runs a comment, given without its bracket, as Python.
inline bool runs_python(std::string_view comment) {
  return begins_with(from_first_word(comment), "PY,");
}

}  // namespace polypod::gcode
