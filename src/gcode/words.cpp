// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "words.hpp"

#include <fmt/format.h>

#include <cctype>
#include <cmath>
#include <vector>

#include "polypod/core/nearest_word.hpp"

namespace polypod::gcode {

int code_of(const Word& word) {
  const double rounded = std::round(word.value * 10);
  if (std::abs(rounded / 10 - word.value) > 1e-9 || rounded < 0 || rounded > 99999) return -1;
  return static_cast<int>(rounded);
}

bool is_cycle(int g) {
  return g == 730 || g == 740 || (g >= 810 && g <= 890 && g % 10 == 0);
}
bool is_zero_group(int g) {
  return g == 40 || g == 100 || g == 280 || g == 281 || g == 300 || g == 301 || g == 520 || g == 530 ||
         (g >= 920 && g <= 923);
}
bool is_motion(int g) {
  return g == 0 || g == 10 || g == 20 || g == 30 || g == 800 || is_cycle(g) || (g >= 50 && g <= 53) ||
         (g >= 382 && g <= 385);
}
int group_of(int g) {
  if (is_motion(g)) return 1;
  if (g >= 921 && g <= 923) return 21;  // LinuxCNC 2.9 takes them beside those of group 0
  if (is_zero_group(g)) return 20;
  switch (g) {
    case 170:
    case 180:
    case 190:
      return 2;
    case 900:
    case 910:
      return 3;
    case 901:
    case 911:
      return 4;
    case 930:
    case 940:
      return 5;
    case 200:
    case 210:
      return 6;
    case 400:
    case 410:
    case 411:
    case 420:
    case 421:
      return 7;
    case 430:
    case 431:
    case 490:
      return 8;
    case 980:
    case 990:
      return 10;
    case 540:
    case 550:
    case 560:
    case 570:
    case 580:
    case 590:
    case 591:
    case 592:
    case 593:
      return 12;
    case 610:
    case 611:
    case 640:
      return 13;
    case 970:
      return 14;
    default:
      return 0;
  }
}

std::array<std::size_t, 3> axes_of(Plane plane) {
  return plane == Plane::xy   ? std::array<std::size_t, 3>{0, 1, 2}
         : plane == Plane::zx ? std::array<std::size_t, 3>{2, 0, 1}
                              : std::array<std::size_t, 3>{1, 2, 0};
}

std::string missing_number_hint(std::string_view line, std::size_t at) {
  static const std::vector<std::string> kFlow{"sub",      "endsub",   "call",   "do",     "while",
                                              "endwhile", "if",       "elseif", "else",   "endif",
                                              "break",    "continue", "return", "repeat", "endrepeat"};
  std::string name;
  while (at < line.size() && std::isalpha(static_cast<unsigned char>(line[at])) != 0)
    name += static_cast<char>(std::tolower(static_cast<unsigned char>(line[at++])));
  constexpr std::size_t kWord = 2;
  if (name.size() >= kWord) {
    const bool labelled = begins_with(from_first_word(line), "O");
    if (const std::string meant = nearest_word(name, kFlow); labelled && !meant.empty())
      return fmt::format("did you mean '{}' behind the O word?", meant);
    if (name == "if" || name == "while" || name == "end" || name == "goto" || name == "then" || name == "do")
      return "this is how other controllers write macros; LinuxCNC takes O words: o1 if [...] ... o1 endif, o2 while "
             "[...] ... o2 endwhile";
  }
  if ((name == "go" || name == "mo")) {
    return fmt::format("is the digit 0 meant, {}0?", name == "go" ? "G" : "M");
  }
  return "is the file complete? every letter outside comments needs a number";
}

}  // namespace polypod::gcode
