// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Lines of text as blocks, one after the other: what `parse` does, for text that is not at hand as a whole.
#pragma once

#include <array>
#include <string>
#include <string_view>
#include <utility>

#include "polypod/gcode/program.hpp"

namespace polypod::gcode {

class LineReader {
 public:
  explicit LineReader(const std::string& path) { program_.path = path; }
  /// A line with its ending; with the `number` that it has, else the next one. Errors: those of `parse`.
  Status add(std::string_view line, int number = 0);
  Program take() { return std::move(program_); }

 private:
  static constexpr std::size_t kMostWords = 64;
  [[nodiscard]] tl::unexpected<Error> error(const Block& block, std::size_t at, std::string id, std::string message,
                                            std::string hint) const;
  Status read_block(Block& block);
  Status read_percent(Block& block, std::size_t at, bool first);
  Result<std::size_t> skip_comment(const Block& block, std::size_t at) const;

  Program program_;
  int line_ = 0;
  std::array<Word, kMostWords> words_;  // of the line at hand
  bool opened_ = false;                 // a `%` was seen
  bool content_ = false;                // a line that is neither blank nor `%` was seen
  bool ended_ = false;                  // closing `%`, M2 or M30
};

}  // namespace polypod::gcode
