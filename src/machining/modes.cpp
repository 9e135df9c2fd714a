// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "modes.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace polypod::machining {
namespace {

/// For each block the last block up to it that holds a path control word; -1 where there is none.
LongVector<int> control_blocks(const gcode::Program& program) {
  LongVector<int> out(program.blocks.size(), -1);
  int last = -1;
  for (std::size_t b = 0; b < program.blocks.size(); ++b) {
    const gcode::Block block = program.blocks[b];
    for (const gcode::Word& w : block.words) {
      if (w.letter == 'G' && (w.value == 61 || w.value == 61.1 || w.value == 64)) last = static_cast<int>(b);
    }
    out[b] = last;
  }
  return out;
}

/// The share of the feed per tooth that is left where the controller passes at `speed`: see SlowCorners.
double chip_share(const Job& job, const gcode::Move& move, double speed) {
  const double teeth = move.spindle_speed * job.cutter_of(move.tool).teeth;  // a second
  if (!(teeth > 0) || !(move.feed > 0)) return 1;
  return std::min(1.0, (speed + job.controller.planner.acceleration / (4 * teeth)) / move.feed);
}

}  // namespace

Corners corners_of(const Job& job, const gcode::Program& program, const Way& way, const Prediction& prediction,
                   double inside, const LongVector<double>* before) {
  const PassMoves moves = way.commanded();
  const LongVector<Corner> at = corners(moves, job.controller.planner);
  const LongVector<double>& distance = prediction.commanded_distance;
  const LongVector<int> control = control_blocks(program);
  Corners out;
  out.deviation.assign(moves.size(), 0);
  out.with = distance;
  out.slack.assign(moves.size(), std::numeric_limits<double>::infinity());
  out.time = program_time(moves, job.controller.planner);
  const auto line_of = [&](std::size_t m) {
    return way.lines->blocks[static_cast<std::size_t>((*way.programmed)[way.source_of(m)].block)].line;
  };
  /// What a corner may add to a move.
  const auto left_to = [&](std::size_t m) {
    const bool outside = before != nullptr && distance[m] > inside;
    return (outside ? std::max(inside, (*before)[way.source_of(m)]) : inside) - distance[m];
  };
  for (std::size_t c = 0; c + 1 < moves.size(); ++c) {
    std::size_t next = c + 1;
    while (next + 1 < moves.size() && !(moves[next].length() > 0)) ++next;
    const bool cuts_before = prediction.commanded_ends[c].end, cuts_after = prediction.commanded_ends[next].start;
    if (!cuts_before && !cuts_after) continue;
    if (cuts_before) out.slack[c] = left_to(c);
    if (cuts_after) out.slack[c] = std::min(out.slack[c], left_to(next));
    const double deviation = at[c].deviation;
    const std::size_t i = way.source_of(c);
    const bool waits =
        cuts_before && way.source_of(next) != i && dwell_after(*way.programmed, *way.lines, i).possible > 0;
    if (deviation > std::max(out.slack[c], 0.0)) {
      out.kept = false;
      for (const std::size_t m : {c, next}) {
        const int block = control[static_cast<std::size_t>(moves[m].block)];
        if (moves[m].path.mode != gcode::PathMode::continuous) continue;  // the one beside it does
        if (block >= 0 && std::find(out.breaking.begin(), out.breaking.end(), block) == out.breaking.end()) {
          out.breaking.push_back(block);
        }
      }
    }
    for (const std::size_t m : {c, next}) {
      if (!(m == c ? cuts_before : cuts_after)) continue;
      const Prediction::WithoutChips& without = prediction.commanded_without_chips[m];
      const double share = m == c && waits ? 0 : chip_share(job, moves[m], at[c].speed);
      const double slow = share * distance[m] +
                          (1 - share) * static_cast<double>(m != c  ? without.start
                                                            : waits ? without.at_rest
                                                                    : without.end) +
                          deviation;
      if (share < 1 && distance[m] + deviation <= inside && slow > distance[m] + deviation) {
        out.slow.add(slow, share, line_of(m), job.tolerance);
      }
      out.deviation[m] = std::max(out.deviation[m], deviation);
      out.with[m] = std::max(out.with[m], distance[m] + deviation);
      out.largest = std::max(out.largest, deviation);
    }
  }
  for (std::size_t m = 0; m < out.with.size(); ++m) {
    if (!(out.with[m] > out.largest_with)) continue;
    out.largest_with = out.with[m];
    out.line = line_of(m);
  }
  return out;
}

PathModeChoice mode_for(const Job& job, const Way& way, const Corners& corners) {
  return choose_path_mode(way.commanded(), corners.slack, job.controller.planner);
}

}  // namespace polypod::machining
