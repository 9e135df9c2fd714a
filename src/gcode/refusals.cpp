// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "refusals.hpp"

#include <fmt/format.h>

#include <cmath>

namespace polypod::gcode {

Refusal refusal_of(int g) {
  switch (g) {
    case 401:
      return {"GC121", "a word of other controllers", "cancel cutter radius compensation with G40"};
    case 90:
      return {"GC120", "a word of other controllers, which LinuxCNC refuses", "for an exact stop use G61.1"};
    case 150:
    case 500:
    case 501:
    case 690:
      return {"GC120", "a word of other controllers, which LinuxCNC refuses",
              "remove it: it cancels what LinuxCNC does not have"};
    case 60:
    case 61:
    case 62:
    case 63:
      return {"GC127", "this spline is not supported", "post the program with lines, arcs, or G5 to G5.3"};
    case 330:
    case 331:
    case 760:
      return {"GC128", "motion synchronised with the spindle: where the tool is follows an encoder, not the program",
              "mill the thread with helices (G2, G3), or tap with G84"};
    case 310:
    case 380:
    case 382:
    case 383:
    case 384:
    case 385:
      return {"GC128", "where the tool stops follows a probe, not the program", "leave probing out"};
    case 950:
    case 960:
      return {"GC129", "feed per revolution and constant surface speed follow the measured spindle and the radius in X",
              "use G94 with the feed per minute, and G97 with the speed"};
    case 70:
    case 80:
    case 700:
    case 710:
    case 711:
    case 712:
    case 720:
    case 721:
    case 722:
    case 320:
    case 340:
      return {"GC130", "a word of lathes, where X is a radius or a diameter of a part that turns",
              "post the program for a mill"};
    case 432:
      return {"GC125", "a second tool length is not supported", "use G43 with the sum"};
    case 160:
    case 510:
    case 511:
    case 680:
    case 681:
    case 682:
    case 534:
    case 434:
    case 435:
      return {"GC125", "it scales, turns, mirrors or tilts the coordinates, which LinuxCNC does not know",
              "use G54 to G59 with the offsets of the job, or G10 L2 with R"};
    case 541:
      return {"GC125", "it is a further work offset of other controllers, which LinuxCNC does not know",
              "use G54 to G59.3 with the offsets of the job, or G10 L2"};
    case 650:
    case 660:
    case 661:
    case 670:
      return {"GC123", "a macro call, which LinuxCNC does not know", "call a subprogram with O words or M98"};
    default:
      return {"GC120", "Polypod does not know this G code", "it may change motion: remove it, or post for LinuxCNC"};
  }
}

std::optional<WrongArgument> wrong_argument(const Block& block) {
  const auto find = [&](char letter) -> const Word* {
    for (const Word& word : block.words)
      if (word.letter == letter) return &word;
    return nullptr;
  };
  for (const Word& word : block.words) {
    if (word.letter != 'M') continue;
    const int m = static_cast<int>(word.value);
    const Word *p = find('P'), *e = find('E'), *r = find('R'), *q = find('Q'), *l = find('L');
    if (m >= 62 && m <= 65 && (p == nullptr || p->value < 0))
      return {{&word, fmt::format("M{} without an output P", m)}};
    if ((m == 67 || m == 68) && (e == nullptr || e->value < 0)) {
      return {{&word, fmt::format("M{} without an output E", m)}};
    }
    if (m == 66 && (p == nullptr) == (e == nullptr)) {
      return {{&word, p == nullptr ? "M66 without an input P or E" : "M66 with both P and E"}};
    }
    if (m == 66 && l != nullptr) {
      if (l->value < 0 || l->value != std::floor(l->value)) {
        return {{l, fmt::format("L{:g} of M66 is no way to wait, 0 to 4", l->value)}};
      }
      if (l->value != 0 && e != nullptr) return {{l, "M66 E with L: an analog input is read at once, L0"}};
      if (l->value != 0 && !(q != nullptr && q->value > 0)) return {{l, "M66 L without a time Q to wait"}};
    }
    if (m == 19 && p != nullptr && p->value != 0 && p->value != 1 && p->value != 2) {
      return {{p, fmt::format("P{:g} of M19 is not 0, 1 or 2", p->value)}};
    }
    if (m == 19 && q != nullptr && !(q->value > 0)) {
      return {{q, fmt::format("Q{:g} of M19 is no time to wait", q->value)}};
    }
    if (m == 19 && r != nullptr && !(r->value >= 0 && r->value <= 360)) {
      return {{r, fmt::format("R{} of M19 is not within 0 and 360 deg", r->value)}};
    }
  }
  return {};
}

std::string excluding(const std::string& one, const std::string& other) {
  return one == other ? fmt::format("{} stands twice in one block", one)
                      : fmt::format("{} and {} exclude each other in one block", one, other);
}

}  // namespace polypod::gcode
