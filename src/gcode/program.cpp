// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/gcode/program.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <new>
#include <type_traits>

#include "polypod/core/file_parts.hpp"
#include "reader.hpp"
#include "text.hpp"
#include "words.hpp"

namespace polypod::gcode {
namespace {

bool is_blank(char c) {
  return c == ' ' || c == '\t';
}
bool is_digit(char c) {
  return c >= '0' && c <= '9';
}
bool is_letter(char c) {
  const char u = upper(c);
  return u >= 'A' && u <= 'Z';
}

/// How an error message shows a character.
std::string show(char c) {
  const auto byte = static_cast<unsigned char>(c);
  if (byte > 0x20 && byte < 0x7f) return fmt::format("'{}'", c);
  return fmt::format("the byte 0x{:02x}", byte);
}

/// A number inside a line; blanks are skipped.
struct Number {
  double value = 0;
  std::size_t end = 0;      ///< just after its last character
  std::size_t problem = 0;  ///< where it goes wrong
  enum class Outcome { good, missing, malformed, too_large } outcome = Outcome::missing;
};

Number read_number(std::string_view text, std::size_t at) {
  Number number;
  std::array<char, 400> digits{};
  std::size_t count = 0;
  bool point = false;
  bool any_digit = false;
  std::size_t i = at;
  const auto next = [&] {
    while (i < text.size() && is_blank(text[i])) ++i;
    return i < text.size();
  };
  number.problem = at;
  if (next() && (text[i] == '+' || text[i] == '-')) {
    if (text[i] == '-') digits[count++] = '-';
    number.end = ++i;
    number.outcome = Number::Outcome::malformed;
  }
  while (next()) {
    const char c = text[i];
    number.problem = i;
    if (c == '.') {
      if (point) {
        number.outcome = Number::Outcome::malformed;
        return number;
      }
      point = true;
    } else if (is_digit(c)) {
      any_digit = true;
    } else {
      break;
    }
    if (count < digits.size()) digits[count++] = c;
    number.end = ++i;
  }
  if (!any_digit) {
    if (point) number.outcome = Number::Outcome::malformed;
    return number;
  }
  if (i < text.size() && (text[i] == '+' || text[i] == '-')) {
    number.problem = i;
    number.outcome = Number::Outcome::malformed;
    return number;
  }
  const auto [rest, code] = std::from_chars(digits.data(), digits.data() + count, number.value);
  const bool whole = rest == digits.data() + count && count < digits.size();
  if (code != std::errc() || !whole || !std::isfinite(number.value)) {
    number.problem = at;
    number.outcome = Number::Outcome::too_large;
    return number;
  }
  number.outcome = Number::Outcome::good;
  return number;
}

/// The keywords that make an O number flow control.
constexpr std::array<std::string_view, 14> kKeywords{"SUB",      "ENDSUB",   "CALL",   "DO",    "WHILE",
                                                     "ENDWHILE", "IF",       "ELSEIF", "ELSE",  "ENDIF",
                                                     "BREAK",    "CONTINUE", "RETURN", "REPEAT"};

bool starts_with_keyword(std::string_view text, std::size_t at) {
  std::array<char, 12> letters{};
  std::size_t count = 0;
  for (std::size_t i = at; i < text.size() && count < letters.size(); ++i) {
    if (is_blank(text[i])) continue;
    if (!is_letter(text[i])) break;
    letters[count++] = upper(text[i]);
  }
  const std::string_view name(letters.data(), count);
  return name.starts_with("ENDREPEAT") ||
         std::ranges::any_of(kKeywords, [&](std::string_view word) { return name.starts_with(word); });
}

/// Whether a value other than a number begins at `at`: `#5`, `-#5`, `[1 + 2]`, `sin[30]`, a number with several signs.
Construct construct_at(std::string_view text, std::size_t at) {
  const auto skip_blanks = [&] {
    while (at < text.size() && is_blank(text[at])) ++at;
  };
  int signs = 0;
  for (; at < text.size() && (is_blank(text[at]) || text[at] == '+' || text[at] == '-'); ++at)
    signs += is_blank(text[at]) ? 0 : 1;
  if (at >= text.size()) return Construct::none;
  if (text[at] == '#') return Construct::parameter;
  if (signs > 1 && (is_digit(text[at]) || text[at] == '.')) return Construct::expression;
  std::size_t letters = 0;
  for (; at < text.size() && is_letter(text[at]); ++letters) {
    ++at;
    skip_blanks();
  }
  // A function has at least two letters; a single one is a word of its own.
  return at < text.size() && text[at] == '[' && letters != 1 ? Construct::expression : Construct::none;
}

}  // namespace

tl::unexpected<Error> LineReader::error(const Block& block, std::size_t at, std::string id, std::string message,
                                        std::string hint) const {
  return fail(std::move(id), std::move(message), Place{program_.path, block.line, static_cast<int>(at) + 1},
              std::move(hint));
}

Status LineReader::add(std::string_view line, int number) {
  std::size_t end = line.size();
  if (line.ends_with('\n')) --end;
  while (end > 0 && line[end - 1] == '\r') --end;
  Block block;
  block.text = line.substr(0, end);
  block.ending = line.substr(end);
  block.line = ++line_;
  block.after_end = ended_;
  if (!ended_) POLYPOD_TRY(read_block(block));
  if (number > 0) block.line = number;
  program_.blocks.push_back(block);
  return {};
}

Status LineReader::read_block(Block& block) {
  const std::string_view text = block.text;
  std::array<Word, kMostWords>& words = words_;
  std::size_t count = 0;
  bool first = true;  // nothing but blanks and comments so far
  bool commented = false, labelled = false;
  for (std::size_t i = 0; i < text.size();) {
    const char c = text[i];
    if (is_blank(c)) {
      ++i;
      continue;
    }
    if (c == '(' || c == ';') {
      POLYPOD_ASSIGN(end, skip_comment(block, i));
      i = end;
      commented = true;
      continue;
    }
    if (labelled) return error(block, i, "GC163", fmt::format("{} {}", show(c), kBehindO), kBehindOHint);
    if (c == '%') {
      POLYPOD_TRY(read_percent(block, i, first));
      first = false;
      ++i;
      continue;
    }
    if (c == '/') {
      if (!first) {
        return error(block, i, "GC106", "'/' within a block; block delete stands at the start of its line",
                     "move '/' to the start of the line, or remove it");
      }
      block.optional = true;
      first = false;
      ++i;
      continue;
    }
    if (c == '#' || c == '[' || c == '$') {
      block.construct = c == '#' ? Construct::parameter : Construct::expression;
      block.construct_column = static_cast<int>(i) + 1;
      break;
    }
    if (c == '*') return error(block, i, "GC107", kStar, kStarHint);
    if (!is_letter(c) && c != '@' && c != '^') {
      return error(block, i, "GC100", fmt::format("{} does not belong into a block", show(c)),
                   c == '\r'                          ? "end lines with LF or CR LF"
                   : text.starts_with("\xef\xbb\xbf") ? "save the file without a byte order mark"
                   : c == ',' && count > 0            ? "write a point in numbers"
                   : is_digit(c) || c == '.'          ? "a letter is missing before the number"
                                                      : "remove it, or put it into a comment");
    }
    first = false;
    const char letter = upper(c);
    std::size_t after = i + 1;
    while (after < text.size() && is_blank(text[after])) ++after;
    if (letter == 'N' && after < text.size() && !is_digit(text[after]) && text[after] != '(' && text[after] != ';') {
      return error(block, i, "GC106", "N without the digits of a line number", "write N and an integer from 0");
    }
    const bool at_start = count == 0 || (count == 1 && words[0].letter == 'N');
    if (letter == 'O' && (commented || !at_start)) return error(block, i, "GC163", kOWithin, kOWithinHint);
    if (const Construct value = construct_at(text, after); value != Construct::none) {
      block.construct = value;
      block.construct_column = static_cast<int>(after) + 1;
      break;
    }
    if (letter == 'O' && after < text.size() && text[after] == '<') {
      block.construct = Construct::o_word;
      block.construct_column = static_cast<int>(i) + 1;
      break;
    }
    const Number number = read_number(text, i + 1);
    switch (number.outcome) {
      case Number::Outcome::good:
        break;
      case Number::Outcome::missing:
        return error(block, i, "GC101", fmt::format("{} without a number", letter), missing_number_hint(text, i));
      case Number::Outcome::malformed:
        return error(block, number.problem, "GC102", fmt::format("{} with a malformed number", letter),
                     "write [+-] digits, with at most one point and no exponent");
      case Number::Outcome::too_large:
        return error(block, i, "GC102", fmt::format("{} with a number that is too large", letter),
                     "the number does not fit a double");
    }
    if (letter == 'N' && count > 0) {
      return error(block, i, "GC106", "N within a block; a line number stands at the start of its line",
                   "move N to the start of the line, or remove it");
    }
    if (count == words.size()) {
      return error(block, i, "GC108", fmt::format("more than {} words in one block", words.size()), "split the block");
    }
    words[count++] = Word{letter, number.value, static_cast<int>(i) + 1, static_cast<int>(number.end - i)};
    i = number.end;
    if (letter == 'O') {
      if (number.value != std::floor(number.value)) {
        return error(block, static_cast<std::size_t>(words[count - 1].column) - 1, "GC163",
                     fmt::format("O{} is no label; labels are integers", number.value), "use an integer");
      }
      labelled = true;
    }
    if (letter == 'O' && starts_with_keyword(text, i)) {
      block.construct = Construct::o_word;
      block.construct_column = words[count - 1].column;
      break;
    }
  }
  block.words = {words.data(), count};
  content_ = content_ || (!block.percent && !std::ranges::all_of(text, is_blank));
  if (!block.optional && block.construct == Construct::none) {
    ended_ = ended_ || std::ranges::any_of(block.words, [](const Word& word) {
               return word.letter == 'M' && (word.value == 2 || word.value == 30);
             });
  }
  return {};
}

Status LineReader::read_percent(Block& block, std::size_t at, bool first) {
  if (!first || !is_percent(block.text)) {
    const std::size_t beside = block.text.find_first_not_of(" \t\r", at + 1);
    return error(block, first && beside != std::string_view::npos ? beside : at, "GC105",
                 "'%' within a block; '%' stands alone on its line, without a comment", "move it to its own line");
  }
  if (!opened_ && content_) {
    return error(block, at, "GC105", "'%' in a program that did not begin with '%'",
                 "begin the program with a '%' line, or remove this one");
  }
  block.percent = true;
  if (opened_) ended_ = true;
  opened_ = true;
  return {};
}

/// The position after the comment that begins at `at`.
Result<std::size_t> LineReader::skip_comment(const Block& block, std::size_t at) const {
  const std::string_view text = block.text;
  // A lone CR would hide the rest of the line from a reader who sees two lines.
  const std::size_t cr = text.find('\r', at);
  const std::size_t close = text[at] == ';' ? text.size() : text.find(')', at);
  if (cr != std::string_view::npos && (close == std::string_view::npos || cr < close)) {
    return error(block, cr, "GC100", "the byte 0x0d within a line", "end lines with LF or CR LF");
  }
  if (text[at] == ';') return text.size();
  if (const std::size_t nul = text.find('\0', at); nul < close) {
    return error(block, nul, "GC100", "the byte 0x00 within a comment, where LinuxCNC ends the line", "remove it");
  }
  const std::size_t nested = text.find('(', at + 1);
  if (close == std::string_view::npos) {
    return error(block, at, "GC103", "a comment that is not closed on its line", "add ')'");
  }
  if (nested != std::string_view::npos && nested < close) {
    return error(block, nested, "GC103", "'(' within a comment; comments do not nest", "use other brackets inside");
  }
  if (runs_python(text.substr(at + 1))) {
    return error(block, at, "GC122", "a comment that LinuxCNC runs as Python",
                 "take it out, or write what it does as G-code");
  }
  return close + 1;
}

struct Blocks::Head {
  std::uint32_t text = 0, ending = 0, words = 0;  // how many of them follow: words first
  std::int32_t line = 0;
  std::int32_t construct_column = 0;
  bool optional = false, percent = false, after_end = false;
  Construct construct = Construct::none;
};

namespace {

/// What a block and its head both hold.
void copy_facts(const auto& from, auto& to) {
  to.line = from.line;
  to.optional = from.optional;
  to.percent = from.percent;
  to.after_end = from.after_end;
  to.construct = from.construct;
  to.construct_column = from.construct_column;
}

}  // namespace

Block Blocks::operator[](std::size_t i) const {
  static_assert(sizeof(Head) == 24 && sizeof(Word) == 24 && std::is_trivially_copyable_v<Word>);
  const char* const at = bytes_.run(at_[i]);
  const Head& head = *std::launder(reinterpret_cast<const Head*>(at));
  const auto* words = std::launder(reinterpret_cast<const Word*>(at + sizeof(Head)));
  const char* const text = at + sizeof(Head) + head.words * sizeof(Word);
  Block block;
  block.text = {text, head.text};
  block.ending = {text + head.text, head.ending};
  copy_facts(head, block);
  block.words = {words, head.words};
  return block;
}

void Blocks::push_back(const Block& block) {
  Head head;
  head.text = static_cast<std::uint32_t>(block.text.size());
  head.ending = static_cast<std::uint32_t>(block.ending.size());
  head.words = static_cast<std::uint32_t>(block.words.size());
  copy_facts(block, head);
  at_.push_back(bytes_.size());
  bytes_.append(reinterpret_cast<const char*>(&head), sizeof head);
  bytes_.append(reinterpret_cast<const char*>(block.words.data()), block.words.size() * sizeof(Word));
  bytes_.append(block.text.data(), block.text.size());
  bytes_.append(block.ending.data(), block.ending.size());
  constexpr std::array<char, alignof(Word)> kZeros{};
  const std::size_t over = bytes_.size() % alignof(Word);
  if (over != 0) bytes_.append(kZeros.data(), alignof(Word) - over);
}

void Blocks::set_line(std::size_t i, int line) {
  std::launder(reinterpret_cast<Head*>(&bytes_[at_[i]]))->line = line;
}

void Blocks::clear() {
  at_.clear();
  bytes_.clear();
}

Result<Program> parse(std::string_view text, const std::string& path) {
  LineReader reader(path);
  while (!text.empty()) {
    const std::size_t newline = text.find('\n');
    const std::size_t next = newline == std::string_view::npos ? text.size() : newline + 1;
    POLYPOD_TRY(reader.add(text.substr(0, next)));
    text.remove_prefix(next);
  }
  return reader.take();
}

Result<Program> read(const std::string& path) {
  LineReader reader(path);
  std::string begun;  // a line of which the end is not read yet
  const auto take = [&](std::string_view text) -> Status {
    while (!text.empty()) {
      const std::size_t newline = text.find('\n');
      if (newline == std::string_view::npos) {
        begun += text;
        return {};
      }
      if (begun.empty()) {
        POLYPOD_TRY(reader.add(text.substr(0, newline + 1)));
      } else {
        begun += text.substr(0, newline + 1);
        POLYPOD_TRY(reader.add(begun));
        begun.clear();
      }
      text.remove_prefix(newline + 1);
    }
    return {};
  };
  POLYPOD_TRY(files::read_parts(path, take));
  if (!begun.empty()) POLYPOD_TRY(reader.add(begun));
  return reader.take();
}

Result<Program> read_back(const Program& program, const std::string& path) {
  LineReader reader(path);
  std::string line;
  for (const Block& block : program.blocks) {
    line = block.text;
    line += block.ending;
    POLYPOD_TRY(reader.add(line));
  }
  return reader.take();
}

std::string to_text(const Program& program) {
  std::size_t size = 0;
  for (const Block& block : program.blocks) size += block.text.size() + block.ending.size();
  std::string text;
  text.reserve(size);
  for (const Block& block : program.blocks) {
    text += block.text;
    text += block.ending;
  }
  return text;
}

std::vector<std::string_view> comments(const Block& block) {
  std::vector<std::string_view> found;
  const std::string_view text = block.text;
  for (std::size_t i = 0; i < text.size();) {
    if (text[i] == ';') {
      found.push_back(text.substr(i));
      break;
    }
    if (text[i] != '(') {
      ++i;
      continue;
    }
    const std::size_t close = text.find(')', i);
    const std::size_t end = close == std::string_view::npos ? text.size() : close + 1;
    found.push_back(text.substr(i, end - i));
    i = end;
  }
  return found;
}

}  // namespace polypod::gcode
