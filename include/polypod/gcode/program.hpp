// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Program text without loss: printing an unchanged program gives it back byte for byte.
#pragma once

#include <cstdint>
#include <iterator>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/core/long_vector.hpp"

namespace polypod::gcode {

/// A letter and its number as it stands in the text: `X-1.50`.
struct Word {
  char letter = 0;   ///< upper case; `@` and `^` for polar coordinates
  double value = 0;  ///< as written: mm or inch, deg, mm/min, ...; finite
  int column = 0;    ///< 1-based, of the letter, in Block::text
  int length = 0;    ///< characters from the letter to the end of the number
};

/// What a block holds beyond words. Such blocks are kept as text, and `interpret` refuses them.
enum class Construct : std::uint8_t {
  none,
  parameter,   ///< `#5`, `#<name>`
  expression,  ///< `[1 + 2]`
  o_word       ///< `o100 sub`, `o<name> call`, `o1 if [...]`
};

/// One line of the file. Text and words are views: of the program that it comes from, which must live and must not
/// grow meanwhile.
struct Block {
  std::string_view text;                  ///< the line without its ending
  std::string_view ending;                ///< "\n", "\r\n" or "" (a last line without one)
  int line = 0;                           ///< 1-based
  bool optional = false;                  ///< begins with `/` (block delete)
  bool percent = false;                   ///< a `%` line
  bool after_end = false;                 ///< stands after the closing `%`, M2 or M30: kept as text only
  Construct construct = Construct::none;  ///< words stop before it
  int construct_column = 0;               ///< 1-based
  std::span<const Word> words;            ///< in the order of the text, N words included
};

/// The blocks of a program, packed; where they are many they lie in a temporary file (LongVector).
class Blocks {
 public:
  class const_iterator {
   public:
    using iterator_category = std::input_iterator_tag;
    using value_type = Block;
    using difference_type = std::ptrdiff_t;
    using reference = Block;
    struct pointer {
      Block block;
      const Block* operator->() const { return &block; }
    };
    const_iterator() = default;
    const_iterator(const Blocks* blocks, std::size_t at) : blocks_(blocks), at_(at) {}
    Block operator*() const { return (*blocks_)[at_]; }
    pointer operator->() const { return {(*blocks_)[at_]}; }
    const_iterator& operator++() {
      ++at_;
      return *this;
    }
    const_iterator operator++(int) {
      const const_iterator before = *this;
      ++at_;
      return before;
    }
    friend bool operator==(const const_iterator& a, const const_iterator& b) { return a.at_ == b.at_; }

   private:
    const Blocks* blocks_ = nullptr;
    std::size_t at_ = 0;
  };
  using value_type = Block;
  using iterator = const_iterator;

  [[nodiscard]] std::size_t size() const { return at_.size(); }
  [[nodiscard]] bool empty() const { return at_.empty(); }
  [[nodiscard]] Block operator[](std::size_t i) const;
  [[nodiscard]] Block front() const { return (*this)[0]; }
  [[nodiscard]] Block back() const { return (*this)[size() - 1]; }
  [[nodiscard]] const_iterator begin() const { return {this, 0}; }
  [[nodiscard]] const_iterator end() const { return {this, size()}; }
  /// Adds a copy of the block, its text and its words, which must not be this program's own.
  void push_back(const Block& block);
  void set_line(std::size_t i, int line);
  void clear();

 private:
  struct Head;
  LongVector<std::uint64_t> at_;  // where each block begins in bytes_
  LongVector<char> bytes_;
};

struct Program {
  std::string path;  ///< for error messages
  Blocks blocks;
};

/// Splits text into blocks and words.
///
/// A number is `[+-] digits [. digits]` with at least one digit and no exponent; blanks and tabs may stand anywhere
/// outside comments, also inside numbers, as in RS-274 (`X 1 0.5` is X10.5). Letters may be lower case. Comments are
/// `(...)`, closed on their line, or `;` to the end of the line. Lines after a `%` that closes the program, or after M2
/// or M30, are kept as text and not looked at.
/// Errors (docs/gcode.md): GC100 a byte that no dialect uses, GC101 a letter without a number, GC102 a number that is
/// malformed or not finite, GC103 a comment that is not closed, or nested, GC105 a misplaced `%`, GC106 a misplaced
/// `/`, GC107 a `*` outside of brackets. Each names file, line and column. Cost: linear; constant memory per line
/// beyond the text.
Result<Program> parse(std::string_view text, const std::string& path);

/// `parse` of the file `path`. Errors: those of `parse`, FI100.
Result<Program> read(const std::string& path);

/// `parse` of the text of a program, which may have changed since it was read.
Result<Program> read_back(const Program& program, const std::string& path);

/// The text again, byte for byte where nothing was changed.
std::string to_text(const Program& program);

/// The texts of the comments of a block, with their brackets or semicolon, in order.
std::vector<std::string_view> comments(const Block& block);

/// The comment by which a corrected program is known; the name of its machine follows.
inline constexpr const char* kCorrectedMark = "Polypod: corrected for the static compliance of";

/// The letters of the numbers that an M word takes, `P` of M52 or `RQP` of M19; of most words none.
std::string_view arguments_of_m(int m);

}  // namespace polypod::gcode
