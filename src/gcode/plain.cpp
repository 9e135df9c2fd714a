// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The plain blocks that a program comes to.
#include <algorithm>
#include <cmath>

#include "engine.hpp"
#include "words.hpp"

namespace polypod::gcode {

bool Engine::shifted() const {
  if (rotation_ != 0) return true;
  const Axes& plain = plain_origins_[static_cast<std::size_t>(plain_system_ - 1)];
  for (std::size_t k = 0; k < 6; ++k) {
    const double there = k < 3 && inches_ ? plain[k] / kMmPerInch : plain[k];
    if (std::abs(origin_[k] + g92_[k] - there) > 1e-12 * (1 + std::abs(there))) return true;
  }
  return false;
}

Axes Engine::to_plain(const Axes& p) const {
  Axes m = to_machine(p);
  const Axes& plain = plain_origins_[static_cast<std::size_t>(plain_system_ - 1)];
  for (std::size_t k = 0; k < 6; ++k) m[k] -= k < 3 && inches_ ? plain[k] / kMmPerInch : plain[k];
  return m;
}

std::string Engine::plain_number(double value, bool step) const {
  return number(value, step ? 9 : inches_ ? 7 : 6);
}

/// X, Y, Z, A, B, C of the plain program for a motion to `end`: those that the block names or that change.
std::string Engine::plain_words(const Axes& end, bool all) const {
  const Axes to = to_plain(end);
  const Axes from = to_plain(left_ ? canon_ : current_);
  const auto [first, second, normal] = axes_of(plane_);
  std::string text;
  for (std::size_t k = 0; k < 6; ++k) {
    const bool named = (name_axes_ && (find(kAxisLetters[k]) != nullptr || (k < 2 && polar()))) ||
                       (all && (k == first || k == second)) || (left_ && k < 2) ||
                       (rotation_ != 0 && k < 2 && (find('X') != nullptr || find('Y') != nullptr));
    if (!named && to[k] == from[k]) continue;
    text += fmt::format(" {}{}", kAxisLetters[k], plain_number(incremental_ ? to[k] - from[k] : to[k], incremental_));
  }
  return text;
}

void Engine::begin_plain() {
  motions_.clear();
  rewritten_ = false;
  name_axes_ = true;
  after_spline_ = spline_now_;
  spline_now_ = false;
  motion_before_ = plain_motion_;
}

void Engine::add_plain(std::string_view text, bool as_it_is) {
  if (!options_.plain) return;
  if (!as_it_is && text.empty()) return;
  Block block;
  block.text = text;
  const Blocks& blocks =
      sources_.front()->program->blocks;  // the file goes on with the line endings that it begins with
  block.ending = !blocks.empty() && blocks.front().ending.ends_with("\r\n") ? "\r\n" : "\n";
  block.line = written_block_ != nullptr ? written_block_->line : 0;
  plain_.blocks.push_back(block);
  plain_sources_.push_back(static_cast<std::uint32_t>(frames_.back().source));
}

void Engine::end_plain() {
  if (!options_.plain) return;
  std::string remarks;
  bool expands = false;
  for (const std::string_view text : comments(*block_)) {
    if (!remarks.empty()) remarks += ' ';
    const std::size_t comma = text.find(',');
    std::string head(text.substr(0, std::min(comma, text.size())));
    std::erase_if(head, is_space);
    for (char& c : head) c = upper(c);
    if (head == "(PRINT" || head == "(DEBUG" || head == "(LOG") {
      remarks += text.substr(0, comma + 1);
      in_message_ = true;
      const std::string message = expanded(text.substr(comma + 1), *this);
      in_message_ = false;
      expands = expands || message != text.substr(comma + 1);
      remarks += message;
    } else {
      remarks += text;
    }
  }
  const bool turned = shifted();
  const bool dynamic = g_word(431) != nullptr;
  const bool moves = !motions_.empty();
  if ((turned || polar()) && moves) rewritten_ = true;
  const auto join = [](std::string& line, std::string_view word) {
    if (word.empty()) return;
    if (!line.empty()) line += ' ';
    line += word;
  };
  std::string before;
  std::string at_end;
  bool named = false;
  for (const Word& word : block_->words) {
    const int code = word.letter == 'G' || word.letter == 'M' ? code_of(word) : -1;
    if (word.letter == 'O' || word.letter == 'D') continue;
    if (word.letter == 'G' && code >= 410 && code <= 421) continue;
    if (word.letter == 'M' && code >= 700 && code <= 730) continue;
    // M72 has put M51 to M53 beside G64, whose P they take: for the plain program two blocks say the same.
    if (word.letter == 'M' && code >= 510 && code <= 530 && g_word(640) != nullptr) {
      add_plain(fmt::format("M{} P{}", code / 10, value('P') != 0 ? 1 : 0));
      continue;
    }
    std::string text = fmt::format("{}{}", word.letter, number(word.value, 9));
    if (word.letter == 'G' && (code <= 30 || code == 800) && code % 10 == 0) named = true;
    if (rewritten_) {
      if (word.letter == 'N') continue;
      if (word.letter == 'G' &&
          (is_motion(code) || (is_zero_group(code) && code != 40) || (code >= 591 && code <= 593) ||
           (code >= 540 && code <= 590 && code % 10 == 0 && is_own(active_)))) {
        continue;
      }
      if (word.letter == 'M' && m_group_of(code / 10) == 4) {
        join(at_end, text);
        continue;
      }
      if (!dynamic && std::string_view("XYZABCIJK@^").find(word.letter) != std::string_view::npos) continue;
      const bool taken =  // by an M word
          std::any_of(block_->words.begin(), block_->words.end(), [&](const Word& w) {
            return w.letter == 'M' &&
                   arguments_of_m(static_cast<int>(w.value)).find(word.letter) != std::string_view::npos;
          });
      const bool kept = taken || (word.letter == 'P' && g_word(40) != nullptr) ||
                        ((word.letter == 'P' || word.letter == 'Q') && g_word(640) != nullptr);
      if (!kept && std::string_view("RPQL").find(word.letter) != std::string_view::npos) continue;
      if (word.letter == 'F' && inverse_ && moves) continue;
    }
    join(before, text);
  }
  if (!rewritten_) {
    const bool needs_mode = moves && !named && motion_before_ != motion_ / 10;
    if (needs_mode) {
      std::size_t at = 0;
      if (before.starts_with('N')) at = std::min(before.find(' '), before.size() - 1) + 1;
      before.insert(at, fmt::format("G{} ", motion_ / 10));
    }
    if (named && !moves) plain_motion_ = motion_ < 0 ? -1 : motion_ / 10;
    if (block_ == written_block_ && !needs_mode && !block_->optional && !expands) {
      add_plain(block_->text, true);
      return;
    }
    join(before, remarks);
    add_plain(before);
    return;
  }
  const auto wait_at = [this](std::size_t offset, std::size_t motion) {
    if (motion == kNow) return;
    late_[motion].block = plain_.blocks.size();  // its words are known already where it goes round a corner
    late_[motion].offset = offset;
  };
  if (motions_.size() == 1 && g_word(40) == nullptr) {
    wait_at(before.size(), motions_.front().late);
    join(before, motions_.front().text);
    join(before, at_end);
    join(before, remarks);
    add_plain(before, true);
    return;
  }
  join(before, remarks);
  add_plain(before);
  for (Motion& motion : motions_) {
    wait_at(0, motion.late);
    add_plain(motion.text, true);
  }
  add_plain(at_end);
}

/// The blocks, with the compensated moves in their places (a block has one at most).
Program Engine::take_plain() {
  std::erase_if(late_, [](const Late& motion) { return motion.words.empty(); });
  if (late_.empty()) return std::move(plain_);
  std::stable_sort(late_.begin(), late_.end(), [](const Late& a, const Late& b) { return a.block < b.block; });
  Program whole;
  whole.path = plain_.path;
  auto next = late_.begin();
  for (std::size_t i = 0; i < plain_.blocks.size(); ++i) {
    Block block = plain_.blocks[i];
    std::string text(block.text);
    for (; next != late_.end() && next->block == i; ++next) {
      std::string& words = next->words;
      if (next->offset > 0)
        words.insert(0, 1, ' ');
      else if (!text.empty())
        words += ' ';
      text.insert(next->offset, words);
    }
    block.text = text;
    whole.blocks.push_back(block);
  }
  plain_ = {};
  return whole;
}

}  // namespace polypod::gcode
