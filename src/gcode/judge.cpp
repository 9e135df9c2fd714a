// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What `interpret` judges in plain programs, for blocks of programs that it has not judged.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "engine.hpp"
#include "text.hpp"
#include "words.hpp"

namespace polypod::gcode {
namespace {

/// Beyond this no number of a program makes sense, in program units.
constexpr double kLargest = 1e7;

}  // namespace

/// What `interpret` judges in plain programs.
Status Engine::check() {
  std::array<const Word*, 40> groups{};
  std::array<const Word*, 10> m_groups{};
  std::array<const Word*, 26> letters{};
  int acting = motion_;
  int m_words = 0;
  for (const Word& word : block_->words) {
    if (!(std::abs(word.value) <= 1e9)) {
      return error(word.column, "GC135", fmt::format("{} with a number beyond every range", word.letter),
                   "check the number");
    }
    if (word.letter == 'G') {
      const int g = code_of(word);
      if (g < 0) {
        return error(word.column, "GC132", fmt::format("G{} is no G code", word.value), "check the word");
      }
      const int group = group_of(g);
      if (group == 0) {
        const Refusal r = refusal_of(g);
        return error(word.column, r.id, fmt::format("G{}: {}", number(word.value, 1), r.why), r.hint);
      }
      const Word*& slot = groups[static_cast<std::size_t>(group)];
      if (slot != nullptr && group != 30) {
        const bool idle = group == 1 && (g == 800) != (code_of(*slot) == 800);
        if (!idle) {
          return error(word.column, "GC109", excluding("G" + number(slot->value, 1), "G" + number(word.value, 1)),
                       "use two blocks");
        }
        if (g == 800) continue;
      }
      slot = &word;
    } else if (word.letter == 'M') {
      const int m = code_of(word);
      if (m < 0 || m % 10 != 0 || m > 9990) {
        return error(word.column, "GC132", fmt::format("M{} is no M code", word.value), "check the word");
      }
      if (m == 970) {
        return error(word.column, "GC123", "M97 is a call that LinuxCNC does not know", "use O words or M98");
      }
      if (m >= 700 && m <= 730) {
        for (const Word& other : block_->words) {
          if (other.letter == 'N' || &other == &word) continue;
          return error(other.column, "GC119", fmt::format("{} beside M{}", other.letter, m / 10),
                       "move it to a line of its own");
        }
      }
      if (const auto r = refusal_of_m(m / 10, options_.m_codes)) return error(word.column, r->id, r->why, r->hint);
      const int group = m_group_of(m / 10);
      const Word*& slot = m_groups[static_cast<std::size_t>(group)];
      if (group != 0 && slot != nullptr) {
        return error(word.column, "GC109", excluding(fmt::format("M{}", slot->value), fmt::format("M{}", word.value)),
                     "use two blocks");
      }
      slot = &word;
      if (++m_words > kMostMWords) {
        return error(word.column, "GC108", "more than four M words in one block", "use two blocks");
      }
    } else if (word.letter >= 'A' && word.letter <= 'Z') {
      const Word*& slot = letters[static_cast<std::size_t>(word.letter - 'A')];
      if (slot != nullptr) {
        return error(word.column, "GC108", fmt::format("a second {} word in one block", word.letter),
                     "remove one of them");
      }
      slot = &word;
    }
  }
  const auto has = [&](char c) { return letters[static_cast<std::size_t>(c - 'A')]; };
  for (const char c : {'U', 'V', 'W'}) {
    if (has(c) != nullptr) {
      return error(has(c)->column, "GC130", fmt::format("{}: the axes U, V and W are not supported", c),
                   "post the program for X, Y, Z and A, B, C");
    }
  }
  const Word* zero = groups[20];
  const int zero_code = zero != nullptr ? code_of(*zero) : -1;
  const Word* named = groups[1];
  const int motion_code = named != nullptr ? code_of(*named) : -1;
  const bool takes_axes =
      zero_code == 100 || zero_code == 280 || zero_code == 300 || zero_code == 520 || zero_code == 920;
  const bool dynamic = groups[8] != nullptr && code_of(*groups[8]) == 431;
  if (named != nullptr && motion_code != 800 && (takes_axes || dynamic)) {
    return error(named->column, "GC168", "two words of this block use its axis words", "use two blocks");
  }
  if (polar()) {
    const Word& word = find('@') != nullptr ? *find('@') : *find('^');
    if (has('X') != nullptr || has('Y') != nullptr) {
      return error(word.column, "GC119", "X or Y beside polar coordinates", "remove one of them");
    }
    if (zero_code == 530) {
      return error(word.column, "GC168", "polar coordinates beside G53", "use X and Y");
    }
    const Word* plane = groups[2];
    // LinuxCNC asks for the plane before the block.
    if (plane_ != Plane::xy || (plane != nullptr && code_of(*plane) != 170)) {
      return error(word.column, "GC168", "polar coordinates outside of G17", "write G17 in a block before them");
    }
    const bool step = g_word(910) != nullptr || (incremental_ && g_word(900) == nullptr);
    if ((!known_[0] || !known_[1]) && (step || find('@') == nullptr || find('^') == nullptr)) {
      return error(word.column, "GC169", "polar coordinates from a position that is not known",
                   "give X and Y before, in absolute coordinates");
    }
    const bool centred = current_[0] == 0 && current_[1] == 0;
    if (centred && (step || find('^') == nullptr)) {
      return error(word.column, "GC168", "polar coordinates from the origin, where no angle is",
                   "give @ and ^ under G90");
    }
    if (takes_axes) return error(word.column, "GC125", "polar coordinates outside of a motion", "use X and Y");
  }
  const bool axes = axis_words();
  const bool centre = motion_ >= 20 && motion_ <= 30 && (has('I') || has('J') || has('K'));
  const bool moves = !takes_axes && !dynamic && (named != nullptr ? motion_code != 800 : axes || centre);
  acting = !moves ? -1 : named != nullptr ? motion_code : motion_;
  if (axes && !takes_axes && !dynamic && acting < 0) {
    return error(block_->words.front().column, "GC110", "axis words without a motion mode in force",
                 "add G0, G1, G2 or G3");
  }
  if (zero_code == 40) {
    if (has('P') == nullptr || has('P')->value < 0) {
      return error(zero->column, "GC134", "G4 without a time", "write G4 P...");
    }
  }
  if (zero_code == 530 && acting != 0 && acting != 10) {
    return error(zero->column, "GC168", "G53 without G0 or G1", "write G53 G0 X...");
  }
  if (zero_code == 530 && (g_word(910) != nullptr || (incremental_ && g_word(900) == nullptr))) {
    return error(zero->column, "GC168", "G53 under G91", "write G90 before it");
  }

  if (const auto wrong = wrong_argument(*block_))
    return error(wrong->word->column, "GC132", wrong->what, "see the M word in LinuxCNC's reference");

  std::uint32_t used = 0;
  std::uint32_t shared = 0;
  const auto use = [&](std::string_view list) {
    std::uint32_t mask = 0;
    for (const char c : list) mask |= 1u << (c - 'A');
    shared |= used & mask;
    used |= mask;
  };
  use("XYZABCFSTNO");
  if (acting == 20 || acting == 30) use("IJKRP");
  if (acting == 50) use("IJPQ");
  if (acting == 51) use("IJ");
  if (acting == 52) use(motion_code == 52 ? "PL" : "P");
  if (acting >= 730) use("LR");
  if (acting == 730 || acting == 830) use("Q");
  if (acting == 820 || acting == 860 || acting == 880 || acting == 890 || acting == 840 || acting == 740) use("P");
  if (acting == 870) use("IJK");
  if (zero_code == 40) use("P");
  if (zero_code == 100) use("PLRIJQ");
  if (g_word(640) != nullptr) use("PQ");
  if (g_word(430) != nullptr) use("H");
  if (groups[7] != nullptr && code_of(*groups[7]) != 400) {
    use("D");
    const int g = code_of(*groups[7]);
    if (const Word* l = has('L'); l != nullptr && (g == 411 || g == 421)) {
      return error(l->column, "GC121", "L, the orientation of a turning tool: compensation is done in the plane of G17",
                   "remove it");
    }
  }
  for (const Word& word : block_->words) {
    if (word.letter == 'M') use(arguments_of_m(static_cast<int>(word.value)));
  }
  for (char c = 'A'; c <= 'Z'; ++c) {
    const Word* word = has(c);
    if (word == nullptr) continue;
    const std::uint32_t bit = 1u << (c - 'A');
    if ((shared & bit) != 0) {
      return error(word->column, "GC119", fmt::format("{} could belong to several words of this block", c),
                   "use two blocks");
    }
    if ((used & bit) == 0) {
      return error(word->column, "GC119", fmt::format("{} has no use in this block", c),
                   "remove it, or add the G or M word that it belongs to");
    }
    if (std::string_view("XYZABCIJKR").find(c) != std::string_view::npos && !(std::abs(word->value) <= kLargest)) {
      return error(word->column, "GC135", fmt::format("{} is beyond every machine (10 km)", c), "check the number");
    }
  }
  for (const char c : {'T', 'H'}) {
    if (const Word* word = has(c); word != nullptr && (word->value < 0 || word->value != std::floor(word->value))) {
      return error(word->column, "GC132", fmt::format("{}{} is no tool", c, word->value), "use an integer from 0");
    }
  }
  for (const char c : {'F', 'S'}) {
    if (const Word* word = has(c); word != nullptr && word->value < 0) {
      return error(word->column, c == 'F' ? "GC111" : "GC132", fmt::format("{}{} is negative", c, word->value),
                   "check the number");
    }
  }
  if (g_word(430) == nullptr && has('H') != nullptr) {
    return error(has('H')->column, "GC119", "H without G43", "remove it");
  }
  if (moves && acting > 0 && acting != 53) {
    const bool inverse = g_word(930) != nullptr || (inverse_ && g_word(940) == nullptr);
    const bool reset = g_word(930) != nullptr || g_word(940) != nullptr;
    const Word* f = has('F');
    if (inverse && f == nullptr) {
      return error(1, "GC112", "a feed move under G93 without F", "every feed block needs its own F under G93");
    }
    if (!((f != nullptr ? f->value : reset ? 0 : feed_) > 0)) {
      return error(f != nullptr ? f->column : 1, "GC111", "a feed move without a feed",
                   "add F; a G94 forgets the feed before it");
    }
  }
  return {};
}

}  // namespace polypod::gcode
