// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How libFuzzer changes files of lines `key = value`: flipped bytes break the syntax nearly always, so two of three
// inputs change a number, a value or a whole line instead and get past the parser.
#include <array>
#include <cstdint>
#include <cstring>
#include <random>
#include <string>
#include <string_view>
#include <vector>

extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t max_size);

namespace {

using Random = std::minstd_rand;

constexpr std::array<std::string_view, 28> kNumbers = {
    "0",     "-0.0",   "1",    "-1",         "2",    "6",    "0.5",        "1e-3",        "1e-9",
    "1e-15", "1e-320", "1e3",  "1e6",        "1e9",  "1e10", "1e38",       "1e308",       "-1e308",
    "nan",   "inf",    "-inf", "2147483647", "-1e9", "90",   "2147483648", "-2147483649", "9223372036854775807",
    "180"};
constexpr std::array<std::string_view, 16> kValues = {"[]",
                                                      "{}",
                                                      "[[]]",
                                                      "[0, 0, 0]",
                                                      "[[1, 2], [1, 2]]",
                                                      "[[0, 0], [1, 0], [0, 1]]",
                                                      "true",
                                                      "false",
                                                      "\"\"",
                                                      "\"a\\nb\"",
                                                      "\"../x\"",
                                                      "\"\\u0000\"",
                                                      "\"-\"",
                                                      "{ x_mm = 1 }",
                                                      "[1, 2, 3, 4, 5, 6]",
                                                      "2026-01-12"};

template <class List>
auto& pick(List& list, Random& random) {
  return list[random() % list.size()];
}

std::vector<std::string> lines_of(std::string_view text) {
  std::vector<std::string> lines;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    lines.emplace_back(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return lines;
}

/// Another number in the place of one of the line's.
void change_number(std::string& line, Random& random) {
  constexpr std::string_view kOf = "0123456789.eE+-";
  std::vector<std::pair<std::size_t, std::size_t>> numbers;
  for (std::size_t at = line.find('=') + 1; at < line.size();) {  // npos + 1 is 0
    const std::size_t begin = line.find_first_of("0123456789", at);
    if (begin == std::string::npos) break;
    const std::size_t end = std::min(line.find_first_not_of(kOf, begin), line.size());
    numbers.emplace_back(begin, end - begin);
    at = end;
  }
  if (numbers.empty()) return;
  const auto [begin, length] = pick(numbers, random);
  line.replace(begin, length, pick(kNumbers, random));
}

void change(std::vector<std::string>& lines, Random& random) {
  if (lines.empty()) return;
  std::string& line = pick(lines, random);
  const std::size_t equals = line.find('=');
  switch (random() % 8) {
    case 0:
      lines.insert(lines.begin() + static_cast<std::ptrdiff_t>(random() % lines.size()), std::string(line));
      return;
    case 1:
      lines.erase(lines.begin() + static_cast<std::ptrdiff_t>(random() % lines.size()));
      return;
    case 2:
      std::swap(line, pick(lines, random));
      return;
    case 3:
      if (equals != std::string::npos) line = line.substr(0, equals + 1) + " " + std::string(pick(kValues, random));
      return;
    case 4:
      if (equals != std::string::npos) line = line.substr(0, equals) + "2" + line.substr(equals);
      return;
    default:
      change_number(line, random);
  }
}

}  // namespace

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t max_size,
                                               unsigned int seed) {
  Random random(seed);
  if (size == 0 || random() % 3 == 0) return LLVMFuzzerMutate(data, size, max_size);
  std::vector<std::string> lines = lines_of({reinterpret_cast<const char*>(data), size});
  for (unsigned changes = 1 + random() % 3; changes > 0; --changes) change(lines, random);
  std::string text;
  for (const std::string& line : lines) text += line + "\n";
  const std::size_t length = std::min(text.size(), max_size);
  std::memcpy(data, text.data(), length);
  return length;
}
