// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The line of a file in which something is wrong, with the wrong word underlined, as compilers show it.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "polypod/core/error.hpp"

namespace polypod {

/// A line of a file, from 1, without its end and without the mark of byte order that may begin the file. Nothing where
/// `file` is no regular file (standard input, a pipe, `--set`), cannot be read or has no such line. Cost: the file up
/// to that line is read.
std::optional<std::string> line_of(const std::string& file, int line);

/// Where `key` stands in a line of TOML as a word, nearest to the byte `near`: its first byte, from 0.
std::optional<std::size_t> find_word(std::string_view line, std::string_view word, std::size_t near = 0);

/// The number of characters of UTF-8 that begin before this byte, and the byte at which the character of this number
/// begins, both from 0 and cut to the text.
std::size_t character_at(std::string_view text, std::size_t byte);
std::size_t byte_at(std::string_view text, std::size_t character);

/// Two lines that can be printed: `line` behind its number, and below it `^~~` under the `length` bytes from `begin`.
///
///     12 | G1 X10 Y1O F500
///        |          ^
///
/// Control characters and what is not UTF-8 are shown as by `one_line`; tabs stay in both lines, so that the underline
/// stands right whatever their width. Lines of more than 100 columns are cut with "..." round the word. With `length` 0
/// nothing is underlined, and only the first line comes back. Characters are taken as one column wide, those of
/// Chinese, Japanese and Korean as two, combining ones as none.
std::string underlined(int number, std::string_view line, std::size_t begin, std::size_t length);

/// The line that an error is about, read again from its file, with the wrong word underlined as far as it is known;
/// ends with a line end. Empty where the error has no line, or the line cannot be read again (see line_of), or is
/// blank.
///
/// The word begins at the column of the error. Where that is 1, which also stands for the line as a whole, it is looked
/// for: a word of the message that stands once in the line. Columns count characters in TOML (CF ids and files
/// `.toml`), bytes in everything else.
std::string excerpt(const Error& error);

}  // namespace polypod
