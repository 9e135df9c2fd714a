// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <set>

#include "corrector.hpp"
#include "polypod/core/units.hpp"

namespace polypod::machining {

Status Corrector::judge() {
  out_.commanded = way_.moves;
  out_.source = way_.source;
  POLYPOD_TRY(rapids_);
  gcode::Interpretation written;
  for (const PassMove& move : way_.moves) written.moves.push_back(move.move);
  if (const Status follows = accept_reach(job_, named_, written, {}, &as_written_); !follows) {
    Error error = follows.error();
    error.message = "once corrected, " + error.message;
    return tl::unexpected(std::move(error));
  }
  const Way as_it_was = as_programmed();
  const Corners before = corners_of(job_, program_, as_it_was, out_.before, inside());
  const Corners after = corners_of(job_, out_.program, way_, out_.after, inside());
  out_.modes.chords = static_cast<int>(std::count(chords_.begin(), chords_.end(), true));
  out_.modes.corner_before = before.largest;
  out_.modes.corner_after = after.largest;
  out_.modes.time_before = before.time;
  out_.modes.time_after = after.time;
  out_.largest_before = before.largest_with;
  out_.largest_after = after.largest_with;
  out_.before.slow = before.slow;
  out_.after.slow = after.slow;
  outcomes(before, after);
  POLYPOD_TRY(judge_other_switch());
  decide();
  out_.after.notes = after_notes_;
  if (!out_.within_tolerance || !out_.all_judged()) {  // whoever finds the file without its report must see it
    POLYPOD_TRY(finish_text());
    out_.commanded = way_.moves;
  }
  count_short_blocks();
  return {};
}

void Corrector::outcomes(const Corners& before, const Corners& after) {
  LongVector<MoveOutcome> of(moves_.size());
  farthest_.assign(moves_.size(), 0);
  std::vector<bool> cuts(moves_.size(), false);
  for (const MovePrediction& m : out_.before.moves) {
    const auto i = static_cast<std::size_t>(m.move);
    cuts[i] = true;
    of[i].normal_before = m.normal;
    of[i].distance_before = m.largest_distance;
  }
  for (const MovePrediction& m : out_.after.moves) {
    const auto i = static_cast<std::size_t>(m.move);
    cuts[i] = true;
    of[i].normal_after = m.normal;
    of[i].distance_after = m.largest_distance;
  }
  for (std::size_t c = 0; c < way_.moves.size(); ++c) {
    const auto i = static_cast<std::size_t>(way_.source[c]);
    if (changed_[i]) ++(way_.moves[c].transition ? of[i].transitions : of[i].pieces);
    of[i].corner_after = std::max(of[i].corner_after, after.deviation[c]);
    farthest_[i] = std::max(farthest_[i], after.with[c]);
    of[i].within = (c == 0 || way_.source[c - 1] != way_.source[c] || of[i].within) && after.with[c] <= inside();
  }
  for (std::size_t i = 0; i < moves_.size(); ++i) {
    if (changed_[i]) ++out_.rewritten_moves;
    if (frozen_[i]) ++out_.left_as_they_were;
    if (!cuts[i]) continue;
    of[i].move = static_cast<int>(i);
    of[i].line = line_of(i);
    of[i].rewritten = changed_[i];
    of[i].length = moves_[i].length();
    of[i].corner_before = before.deviation[i];
    out_.moves.push_back(of[i]);
  }
}

Status Corrector::judge_other_switch() {
  if (fixed_other_ != nullptr) {
    out_.other_switch = *fixed_other_;
    return {};
  }
  if (!has_optional_blocks(program_)) return {};
  OtherSwitch& other = out_.other_switch.emplace();
  other.block_delete = !job_.block_delete;
  const auto here = [&](Error error) { return tl::unexpected(at_switch(std::move(error), other.block_delete)); };
  gcode::InterpretOptions options = job_.interpret_options();
  options.block_delete = other.block_delete;
  const Result<gcode::Interpretation> programmed = gcode::interpret(program_, options);
  if (!programmed) return here(programmed.error());
  POLYPOD_ASSIGN(position, OtherPosition::of(job_, program_, *programmed, {}));
  POLYPOD_ASSIGN(written, gcode::interpret(out_.program, options));
  FollowedAnyway programmed_anyway, written_anyway;
  POLYPOD_TRY(accept_reach(job_, program_, *programmed, {}, &programmed_anyway));
  if (Status follows = accept_reach(job_, named_, written, {}, &written_anyway); !follows) {
    follows.error().message = "once corrected, " + follows.error().message;
    return here(follows.error());
  }
  too_fast_at_other_switch_ = written_anyway.beyond(programmed_anyway);
  const LongVector<gcode::Move>& moves = position.moves();
  const LongVector<int> move_of_block = moves_by_block(moves);
  const Way as_it_was = way_as_programmed(program_, moves);
  Way way{&program_, &moves, {}, {}};
  const LongVector<int> first_of_block = moves_by_block(moves_);
  for (const gcode::Move& move : written.moves) {
    const int block = source_block(move.block);
    const int source = move_of_block[static_cast<std::size_t>(block)];
    if (source < 0) return mismatch(move);
    const int first = first_of_block[static_cast<std::size_t>(block)];
    const bool rewritten = first >= 0 && changed_[static_cast<std::size_t>(first)];
    add(way, move, static_cast<std::size_t>(source), transition_blocks_[static_cast<std::size_t>(move.block)], moves,
        rewritten);
  }
  PredictOptions predict_options;
  predict_options.step = check_step();
  predict_options.progress = progress("checking with the other position of block delete");
  POLYPOD_ASSIGN(before, predict_way(job_, program_, as_it_was, predict_options));
  if (const Status free = no_rapid_cuts(job_, program_, before.pass); !free) return here(free.error());
  POLYPOD_ASSIGN(after, predict_way(job_, named_, way, predict_options));
  if (const Status free = no_rapid_cuts(job_, named_, after.pass); !free) return here(free.error());
  other.cuts = !before.moves.empty();
  other.distance_before = corners_of(job_, program_, as_it_was, before, inside()).largest_with;
  const Corners corners_after = corners_of(job_, out_.program, way, after, inside());
  other.distance_after = corners_after.largest_with;
  other.line = corners_after.line;
  other.slow = corners_after.slow;
  const std::vector<NotJudged>& open = after.not_judged.empty() ? before.not_judged : after.not_judged;
  if (!open.empty()) other.reason = fmt::format("line {}: {}", open.front().line, open.front().why);
  other.within_tolerance = other.distance_after <= inside() && open.empty();
  other.steep = after.steep;
  other.plunges = after.plunges;
  return {};
}

/// Why a distance is not inside the tube that is no farther than its radius; empty for others.
std::string Corrector::kept_free(double distance) const {
  if (distance > job_.tolerance || distance <= inside()) return "";
  return fmt::format(", of which {:.1f} um are kept free for what the cells of the stock leave open",
                     units::to_um(resolution(job_)));
}

void Corrector::decide() {
  const MoveOutcome* worst = nullptr;
  const auto reach = [&](const MoveOutcome& o) { return farthest_[static_cast<std::size_t>(o.move)]; };
  for (const MoveOutcome& m : out_.moves) {
    if (!m.within && (worst == nullptr || reach(m) > reach(*worst))) worst = &m;
  }
  const bool judged = out_.after.not_judged.empty() && out_.before.not_judged.empty();
  const bool other = !out_.other_switch || out_.other_switch->within_tolerance;
  out_.within_tolerance = worst == nullptr && judged && other;
  if (worst != nullptr) {
    warning_ = fmt::format("NOT within the tube, up to {:.1f} um from the path of line {} of the original",
                           units::to_um(reach(*worst)), worst->line);
    out_.reason = fmt::format("line {}: the deflected tool is up to {:.1f} um from the programmed move", worst->line,
                              units::to_um(worst->distance_after));
    if (worst->corner_after > 0) {
      out_.reason +=
          fmt::format(", and the controller rounds its corner by up to {:.1f} um", units::to_um(worst->corner_after));
    }
    out_.reason += fmt::format("; the tolerance is {:g} um", units::to_um(job_.tolerance));
    out_.reason += kept_free(worst->distance_after);
  } else if (!judged) {
    const NotJudged& first =
        out_.after.not_judged.empty() ? out_.before.not_judged.front() : out_.after.not_judged.front();
    out_.only_not_judged = true;
    out_.reason = fmt::format("line {}: {}{}", first.line, first.why,
                              other ? ". Every distance that was computed is inside the tube" : "");
    warning_ = "NOT judged to be within the tube, see line " + std::to_string(first.line) + " of the original";
  } else if (!other) {
    const OtherSwitch& at = *out_.other_switch;
    const char* position = at.block_delete ? "on" : "off";
    const double distance = units::to_um(at.distance_after);
    if (at.distance_after <= inside() && !at.reason.empty()) {
      warning_ = fmt::format("NOT judged to be within the tube with block delete {}", position);
      out_.reason = fmt::format("with block delete {}, {}", position, at.reason);
    } else {
      warning_ = fmt::format("NOT within the tube with block delete {}, up to {:.1f} um from the path of line {}",
                             position, distance, at.line);
      out_.reason = fmt::format(
          "line {}: with block delete {} the deflected tool is up to {:.1f} um from the programmed move; the "
          "tolerance is {:g} um",
          at.line, position, distance, units::to_um(job_.tolerance));
      out_.reason += kept_free(at.distance_after);
    }
  }
  std::string beyond = as_programmed_ != nullptr ? as_written_.beyond(*as_programmed_) : "";
  if (beyond.empty() && !too_fast_at_other_switch_.empty())
    beyond = fmt::format("{} (with block delete {})", too_fast_at_other_switch_,
                         out_.other_switch->block_delete ? "on" : "off");
  if (out_.within_tolerance && !beyond.empty()) {
    out_.within_tolerance = false;
    out_.joint_too_fast = true;
    warning_ = "a joint is TOO FAST here, and is not in the original";
    out_.reason = "a joint of the corrected program would be too fast, which it is not as programmed: " + beyond;
    out_.remedies = {
        "that feed in the program, or the part at a place where the machine is not near a singular pose "
        "(polypod place)"};
  } else {
    after_notes_.insert(after_notes_.end(), as_written_.notes.begin(), as_written_.notes.end());
  }
  const Prediction& after = out_.after;
  std::set<int> lines;  // with a place that is not judged
  for (const Plunge& plunge : after.plunges) lines.insert(plunge.line);
  if (after.steep.distance > 0) lines.insert(after.steep.line);
  if (after.slow.count > 0) lines.insert(after.slow.line);
  for (MoveOutcome& m : out_.moves) m.judged = !lines.contains(m.line);
  if (out_.within_tolerance && !out_.all_judged()) {
    const Unjudged most = after.farthest_not_judged();
    warning_ = most.distance > 0
                   ? fmt::format("NOT all of the cut is judged, line {} of the original: {}, up to {:.0f} um off{}",
                                 most.line, most.what, units::to_um(most.distance),
                                 most.places > 1 ? fmt::format("; {} places in all", most.places) : "")
                   : std::string("NOT all of the cut is judged, see the report of the correction");
  }
}

void Corrector::count_short_blocks() {
  ShortBlocks& out = out_.short_blocks;
  for (std::size_t c = 0; c < way_.moves.size(); ++c) {
    const auto i = static_cast<std::size_t>(way_.source[c]);
    if (!changed_[i]) continue;
    ++out.written;
    if (!is_short(c)) continue;
    const gcode::Move& move = way_.moves[c].move;
    const double length = move.length(), time = length / (move.feed * job_.controller.planner.feed_override);
    if (out.count++ == 0) {
      out.line = line_of(i);
      out.written_line = out_.program.blocks[static_cast<std::size_t>(move.block)].line;
      out.length = length;
      out.time = time;
    }
    out.length = std::min(out.length, length);
    out.time = std::min(out.time, time);
  }
}

int Corrector::line_of(std::size_t i) const {
  return program_.blocks[static_cast<std::size_t>(moves_[i].block)].line;
}

}  // namespace polypod::machining
