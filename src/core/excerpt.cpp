// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/core/excerpt.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <fstream>
#include <vector>

#include "polypod/core/text.hpp"

namespace polypod {
namespace {

bool leads(char c) {  // begins a character of UTF-8
  return (static_cast<unsigned char>(c) & 0xc0) != 0x80;
}

bool is_letter(char c) {
  return std::isalpha(static_cast<unsigned char>(c)) != 0;
}
bool is_digit(char c) {
  return std::isdigit(static_cast<unsigned char>(c)) != 0;
}

bool is_one_of(std::string_view set, char c) {
  return set.find(c) != std::string_view::npos;
}

/// Whether two characters side by side belong to one word: a point ends a name, but no number.
bool one_word(char a, char b) {
  const auto part = [](char c) { return is_letter(c) || is_digit(c) || !leads(c) || is_one_of("_-+", c); };
  if (a == '.' || b == '.') return is_digit(a) || is_digit(b);
  return part(a) && part(b);
}

/// What is printed of a character, and how many columns it takes.
struct Cell {
  std::string text;
  int width = 1;
};

/// Columns of a character that one_line leaves as it is.
int width_of(std::string_view c) {
  if (c.size() < 2) return 1;
  char32_t code = static_cast<unsigned char>(c[0]) & (0x7fU >> c.size());
  for (const char next : c.substr(1)) code = code << 6 | (static_cast<unsigned char>(next) & 0x3fU);
  const auto in = [code](char32_t first, char32_t last) { return code >= first && code <= last; };
  if (in(0x300, 0x36f) || in(0x200b, 0x200f) || in(0xfe00, 0xfe0f)) return 0;  // combining, without width
  const bool wide = in(0x1100, 0x115f) || in(0x2e80, 0xa4cf) || in(0xac00, 0xd7a3) || in(0xf900, 0xfaff) ||
                    in(0xfe30, 0xfe6f) || in(0xff00, 0xff60) || in(0xffe0, 0xffe6) || in(0x1f300, 0x1faff) ||
                    in(0x20000, 0x3fffd);
  return wide ? 2 : 1;
}

/// The characters of a line, one a cell; `first` becomes the cell of its byte, and `count` the number of cells of its
/// bytes.
std::vector<Cell> cells_of(std::string_view line, std::size_t& first, std::size_t& count) {
  std::vector<Cell> out;
  const std::size_t begin = first, end = first + count;
  first = count = 0;
  for (std::size_t at = 0; at < line.size();) {
    std::size_t next = at + 1;
    while (next < line.size() && !leads(line[next])) ++next;
    const std::string_view c = line.substr(at, next - at);
    Cell cell{c == "\t" ? "\t" : one_line(c), 1};
    cell.width = cell.text == c ? width_of(c) : static_cast<int>(cell.text.size());
    out.push_back(std::move(cell));
    first += next <= begin ? 1 : 0;
    count += next > begin && at < end ? 1 : 0;
    at = next;
  }
  return out;
}

constexpr int kWidest = 100, kTab = 8;
constexpr std::string_view kCut = "...";

/// The cells [from, to) of a line that is at most kWidest columns wide with its marks, round the word.
std::pair<std::size_t, std::size_t> part_of(const std::vector<Cell>& cells, std::size_t first, std::size_t count) {
  const auto width = [&](std::size_t i) { return cells[i].text == "\t" ? kTab : cells[i].width; };
  int whole = 0;
  for (std::size_t i = 0; i < cells.size(); ++i) whole += width(i);
  if (whole <= kWidest) return {0, cells.size()};
  const int room = kWidest - 2 * static_cast<int>(kCut.size());
  // A third of what is left before the word, the rest after it; what one side does not use is the other's.
  std::size_t from = std::min(first, cells.size() - 1), to = from;
  int used = 0;
  for (; to < std::min(first + count, cells.size()) && used + width(to) <= room; ++to) used += width(to);
  const int before = used + (room - used) / 3;
  for (; from > 0 && used + width(from - 1) <= before; --from) used += width(from - 1);
  for (; to < cells.size() && used + width(to) <= room; ++to) used += width(to);
  for (; from > 0 && used + width(from - 1) <= room; --from) used += width(from - 1);
  return {from, to};
}

/// The byte after the bracket or quotation mark that closes the one at `begin`; the end of the line without one.
std::size_t end_of_enclosed(std::string_view line, std::size_t begin) {
  const char open = line[begin];
  if (open == '"' || open == '\'') {
    for (std::size_t i = begin + 1; i < line.size(); ++i) {
      if (line[i] == '\\' && open == '"') {
        ++i;
      } else if (line[i] == open) {
        return i + 1;
      }
    }
    return line.size();
  }
  const char close = open == '[' ? ']' : open == '{' ? '}' : ')';
  int depth = 0;
  for (std::size_t i = begin; i < line.size(); ++i) {
    if (line[i] == open) ++depth;
    if (line[i] == close && --depth == 0) return i + 1;
  }
  return line.size();
}

enum class Kind { program, toml, table };

Kind kind_of(const Error& error) {
  const auto ends = [&](std::string_view suffix) { return error.place.file.ends_with(suffix); };
  if (error.id.starts_with("CF") || ends(".toml")) return Kind::toml;
  if (error.id.starts_with("GC") || ends(".ngc") || ends(".nc")) return Kind::program;
  return Kind::table;
}

/// The byte after the word that begins at `begin`.
std::size_t end_of_word(std::string_view line, std::size_t begin, Kind kind) {
  const auto until = [&](std::string_view stops) { return std::min(line.find_first_of(stops, begin), line.size()); };
  const char c = line[begin];
  if (kind == Kind::table) {
    if (c == '"') return end_of_enclosed(line, begin);
    const bool by_marks = line.find_first_of(",;\t") != std::string_view::npos;
    std::size_t end = until(by_marks ? ",;\t" : " ");
    while (end > begin + 1 && line[end - 1] == ' ') --end;
    return end;
  }
  if (is_one_of(kind == Kind::toml ? "\"'[{" : "[(", c)) return end_of_enclosed(line, begin);
  if (kind == Kind::toml) return std::max(begin + 1, until(" \t,]}#="));
  // A letter and its number, a name of letters, a parameter.
  std::size_t end = begin + 1;
  const auto take = [&](const auto& of) {
    while (end < line.size() && of(line[end])) ++end;
  };
  if (c == '#' || ((c == 'o' || c == 'O') && end < line.size() && line[end] == '<')) {
    if (end < line.size() && line[end] == '<') return std::min(line.find('>', end), line.size() - 1) + 1;
    take(is_digit);
    return end;
  }
  if (is_letter(c) && end < line.size() && is_letter(line[end])) {
    take(is_letter);
    return end;
  }
  std::size_t number = end;
  while (number < line.size() && is_one_of(" \t+-", line[number])) ++number;
  if (number < line.size() && (is_digit(line[number]) || line[number] == '.')) {
    end = number;
    take([](char x) { return is_digit(x) || x == '.'; });
  }
  while (end < line.size() && !leads(line[end])) ++end;
  return end;
}

struct Span {
  std::size_t begin = 0, length = 0;
};

/// Where `word` stands in the line, if it does so once.
std::optional<Span> only(std::string_view line, std::string_view word) {
  const auto first = find_word(line, word);
  if (!first || find_word(line, word, line.size()) != first) return {};
  return Span{*first, word.size()};
}

/// A word of the message that stands once in the line: its first word, if that is none of English, what it quotes, or
/// the value where it begins with "name = value".
std::optional<Span> mentioned(std::string_view line, std::string_view message) {
  std::string_view first = message.substr(0, message.find(' '));
  while (!first.empty() && is_one_of(":,;", first.back())) first.remove_suffix(1);
  if (first.find_first_of("0123456789_") != std::string_view::npos) {
    if (const auto span = only(line, first)) return span;
  }
  for (const char quote : {'"', '`', '\''}) {
    const std::size_t open = message.find(quote);
    const std::size_t close = open == std::string_view::npos ? open : message.find(quote, open + 1);
    if (close == std::string_view::npos) continue;
    if (const auto span = only(line, message.substr(open + 1, close - open - 1))) return span;
  }
  if (const std::size_t at = message.find(' '); message.substr(std::min(at, message.size())).starts_with(" = ")) {
    const std::string_view value = message.substr(at + 3, message.find_first_of(" ,:;", at + 3) - at - 3);
    if (const auto span = only(line, value)) return span;
  }
  return {};
}

/// What is to be underlined of the line; nothing where that is not known.
Span wrong_word(const Error& error, std::string_view line) {
  const Kind kind = kind_of(error);
  const auto column = static_cast<std::size_t>(std::max(1, error.place.column)) - 1;
  const std::size_t begin = kind == Kind::toml ? byte_at(line, column) : std::min(column, line.size());
  const bool placed = begin > 0 || error.id == "CF103" || error.id.starts_with("GC10");  // these have always a word
  if (placed && !line.empty()) return {begin, begin < line.size() ? end_of_word(line, begin, kind) - begin : 1};
  if (const auto span = mentioned(line, error.message)) return *span;
  if (kind == Kind::toml && line.front() == '[') return {0, end_of_word(line, 0, kind)};  // the head of a table
  return {};
}

}  // namespace

std::optional<std::string> line_of(const std::string& file, int line) {
  std::error_code none;
  if (line < 1 || !std::filesystem::is_regular_file(file, none)) return {};
  std::ifstream in(file, std::ios::binary);
  std::string text;
  for (int i = 0; i < line; ++i)
    if (!std::getline(in, text)) return {};
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
  if (line == 1 && text.starts_with(kByteOrderMark)) text.erase(0, kByteOrderMark.size());
  if (text.ends_with('\r')) text.pop_back();
  return text;
}

std::optional<std::size_t> find_word(std::string_view line, std::string_view word, std::size_t near) {
  if (word.empty()) return {};
  std::optional<std::size_t> best;
  const auto away = [near](std::size_t at) { return at > near ? at - near : near - at; };
  for (std::size_t at = line.find(word); at != std::string_view::npos; at = line.find(word, at + 1)) {
    const std::size_t end = at + word.size();
    const bool begins = at == 0 || !one_word(line[at - 1], word.front());
    const bool ends = end == line.size() || !one_word(word.back(), line[end]);
    if (begins && ends && (!best || away(at) < away(*best))) best = at;
  }
  return best;
}

std::size_t character_at(std::string_view text, std::size_t byte) {
  return static_cast<std::size_t>(
      std::count_if(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(std::min(byte, text.size())), leads));
}

std::size_t byte_at(std::string_view text, std::size_t character) {
  std::size_t at = 0;
  for (std::size_t i = 0; at < text.size(); ++at)
    if (leads(text[at]) && i++ == character) break;
  return at;
}

std::string underlined(int number, std::string_view line, std::size_t begin, std::size_t length) {
  constexpr std::size_t kSide = 1000;  // bytes of a long line on either side of the word that are looked at
  if (line.size() > 4 * kSide) {
    std::size_t from = begin > kSide ? begin - kSide : 0;
    while (from < begin && !leads(line[from])) ++from;
    line = line.substr(from, begin - from + 2 * kSide);
    begin -= from;
    length = std::min(length, kSide);
  }
  std::size_t first = begin, count = length;
  const std::vector<Cell> cells = cells_of(line, first, count);
  const auto [from, to] = part_of(cells, first, count);
  const std::string head = fmt::format("{:5} | ", number), below = fmt::format("{:5} | ", "");
  std::string text, marks;
  if (from > 0) {
    text += kCut;
    marks.append(kCut.size(), ' ');
  }
  bool begun = false;
  for (std::size_t i = from; i < to; ++i) {
    const Cell& cell = cells[i];
    text += cell.text;
    if (i < first) marks += cell.text == "\t" ? cell.text : std::string(static_cast<std::size_t>(cell.width), ' ');
    if (i < first || i >= first + count) continue;
    for (int k = 0; k < cell.width; ++k) {
      marks += begun ? '~' : '^';
      begun = true;
    }
  }
  if (!begun && first >= to) marks += '^';  // behind the last character
  if (to < cells.size()) text += kCut;
  while (text.ends_with(' ') || text.ends_with('\t')) text.pop_back();
  return length == 0 ? head + text : fmt::format("{}{}\n{}{}", head, text, below, marks);
}

std::string excerpt(const Error& error) {
  const auto line = line_of(error.place.file, error.place.line);
  if (!line || line->find_first_not_of(" \t") == std::string::npos) return "";
  const Span word = wrong_word(error, *line);
  return underlined(error.place.line, *line, word.begin, word.length) + "\n";
}

}  // namespace polypod
