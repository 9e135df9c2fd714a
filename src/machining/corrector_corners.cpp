// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "corrector.hpp"

namespace polypod::machining {

bool Corrector::is_short(std::size_t c) const {
  const PassMove& m = way_.moves[c];
  const auto i = static_cast<std::size_t>(way_.source[c]);
  if (!changed_[i] || m.move.kind == gcode::MoveKind::rapid) return false;
  constexpr double kGrain = 1e-6;  // m, more than what rounding takes
  const double shortest = job_.controller.shortest_block(moves_[i].feed) - kGrain;
  if (!(m.move.length() < shortest)) return false;
  const auto other = [&](std::size_t k) { return k < way_.source.size() && way_.source[k] == way_.source[c]; };
  const bool alone = !m.transition && !other(c + 1) && !(c > 0 && other(c - 1));
  return !(alone && moves_[i].length() < shortest);
}

Status Corrector::share_corners_of_short_blocks() {
  merged_.assign(moves_.size() + 1, false);
  for (std::size_t c = 0; c < way_.moves.size(); ++c) {
    if (!way_.moves[c].transition || !is_short(c)) continue;
    const auto i = static_cast<std::size_t>(way_.source[c]);
    const bool first = c == 0 || way_.source[c - 1] != way_.source[c];
    merged_[first ? i : i + 1] = true;
  }
  if (!any_merged()) return {};
  const LongVector<double> kept = after_;
  const bool stopped = stops_at() >= 0;
  constexpr int kTries = 20;
  for (int tried = 0; tried < kTries; ++tried) {
    POLYPOD_TRY(share_what_fits(kept));
    // Stops at every corner are no price for a longer block.
    const int joint = stopped ? -1 : stops_at();
    if (!any_merged() || joint < 0) return {};
    bool fewer = false;
    for (const int c : {joint, std::min(joint + 1, static_cast<int>(way_.source.size()) - 1)}) {
      const auto i = static_cast<std::size_t>(way_.source[static_cast<std::size_t>(c)]);
      for (const std::size_t corner : {i, i + 1}) {
        fewer = fewer || merged_[corner];
        merged_[corner] = false;
      }
    }
    if (!fewer) break;
  }
  std::fill(merged_.begin(), merged_.end(), false);
  return write_and_check();
}

int Corrector::stops_at() {
  const Corners now = corners_now();
  if (now.kept) return -1;
  const PathModeChoice choice = mode_for(job_, way_, now);
  return choice.control.mode == gcode::PathMode::exact_stop ? choice.limiting : -1;
}

Status Corrector::share_what_fits(const LongVector<double>& kept) {
  constexpr double kSpare = 0.9;
  constexpr int kTries = 6;
  for (int tried = 0;; ++tried) {
    POLYPOD_TRY(write_and_check());
    bool bad = false, fewer = false;
    for (std::size_t i = 0; i < moves_.size(); ++i) {
      if (after_[i] <= std::max(kept[i] + kSameDistance, kSpare * inside())) continue;
      bad = true;
      for (const std::size_t corner : {i, i + 1}) {
        fewer = fewer || merged_[corner];
        merged_[corner] = false;
      }
    }
    if (!bad) return {};
    if (!fewer || tried == kTries) std::fill(merged_.begin(), merged_.end(), false);
    if (!any_merged()) return write_and_check();
  }
}

Corners Corrector::corners_now() {
  if (before_with_.empty()) {
    before_with_ = corners_of(job_, program_, as_programmed(), out_.before, inside()).with;
  }
  return corners_of(job_, out_.program, way_, out_.after, inside(), &before_with_);
}

Status Corrector::chords_in_place_of_stops() {
  const LongVector<double> kept = after_;
  constexpr int kTries = 6;
  for (int tried = 0; tried < kTries; ++tried) {
    const Corners now = corners_now();
    if (now.kept) return {};
    const PathModeChoice choice = mode_for(job_, way_, now);
    if (choice.control.mode != gcode::PathMode::exact_stop) return {};
    if (!take_chords(choice.not_kept)) break;
    POLYPOD_TRY(write_and_check());
    if (comes_farther_than(kept)) break;
  }
  if (chords_.empty()) return {};
  chords_.clear();
  return write_and_check();
}

bool Corrector::take_chords(const std::vector<int>& joints) {
  bool more = false;
  for (const int joint : joints) {
    std::size_t next = static_cast<std::size_t>(joint) + 1;
    while (next + 1 < way_.moves.size() && !(way_.moves[next].move.length() > 0)) ++next;
    for (const std::size_t c : {static_cast<std::size_t>(joint), next}) {
      const auto i = static_cast<std::size_t>(way_.source[c]);
      if (!changed_[i] || moves_[i].kind != gcode::MoveKind::arc || (!chords_.empty() && chords_[i])) continue;
      chords_.resize(moves_.size(), false);
      chords_[i] = more = true;
    }
  }
  return more;
}

bool Corrector::comes_farther_than(const LongVector<double>& kept) const {
  for (std::size_t i = 0; i < moves_.size(); ++i) {
    if (outside(i) && after_[i] > kept[i] + kSameDistance) return true;
  }
  return is_worse();
}

Status Corrector::choose_modes() {
  const Corners now = corners_now();
  out_.modes.time_without = now.time;
  if (now.kept) return {};
  const gcode::PathControl control = mode_for(job_, way_, now).control;
  if (control == gcode::PathControl{} && now.breaking.empty()) return {};  // no mode would help
  mode_ = control;
  for (const int block : now.breaking) {
    mode_blocks_.push_back(source_block(block));
    out_.modes.replaced.push_back(program_.blocks[static_cast<std::size_t>(mode_blocks_.back())].line);
  }
  out_.modes.written = path_mode_words(*mode_);
  return finish_text();
}

}  // namespace polypod::machining
