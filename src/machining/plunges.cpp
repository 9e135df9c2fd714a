// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "plunges.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "modes.hpp"
#include "polypod/core/units.hpp"
#include "polypod/cutting/ball_stock.hpp"
#include "polypod/cutting/end_force.hpp"

namespace polypod::machining {

std::string Plunge::why() const {
  std::string out = fmt::format(
      "the thrust deflects the tool to {:.0f} um above the end of this plunge, and {}", units::to_um(held_back),
      dwell > 0 && !ball
          ? fmt::format("a dwell of {:g} s leaves up to {:.0f} um of it uncut", dwell, units::to_um(remaining))
          : "without a dwell after it, it is not known how much of that is cut");
  // Rounded up, so that what is advised does.
  if (needed > 0) return out + fmt::format("; G4 P{:g} after it would do", std::ceil(100 * needed) / 100);
  if (ball) return out + "; what a dwell does at the tip of a ball is not known";
  return out + "; no dwell would do, because of the edge forces";
}

void HeldBack::see(std::size_t i, const Sample& sample) {
  const gcode::Move& move = moves_[i];
  if (!is_plunge(move, axis_)) return;
  const double ahead = look_ahead_length(job_.stock, job_.cutter_of(move.tool).radius());
  if (move.length() - move.nearest(sample.command) > std::max(ahead, 1.01 * step_)) return;
  const Vec3 d = move.direction(0), off = sample.bent() - move.end;
  End& end = ends_[i];
  end.held_back = std::max(end.held_back, -d.dot(sample.deflection - sample.weight));
  end.aside = std::max(end.aside, (off - d * d.dot(off)).norm());
}

std::vector<Plunge> HeldBack::take(Plunge& most_within) {
  find_plunges();
  const double tube = job_.tolerance - resolution(job_);
  std::vector<Plunge> out;
  for (const auto& [i, end] : ends_) {
    if (!(end.held_back > 0) || goes_deeper(i)) continue;
    const Plunge plunge = judge(i, end, tube);
    if (plunge.distance > tube) {
      // Cut to depth, and outside by its lateral deviation, which is one of the move's distances.
      if (plunge.remaining > resolution(job_)) out.push_back(plunge);
    } else if (plunge.distance > most_within.distance) {
      most_within = plunge;
    }
  }
  return out;
}

Plunge HeldBack::judge(std::size_t i, const End& end, double tube) const {
  const gcode::Move& move = moves_[i];
  const int teeth = job_.cutter_of(move.tool).teeth;
  Plunge out;
  out.line = lines_.blocks[static_cast<std::size_t>(move.block)].line;
  out.held_back = end.held_back;
  out.dwell = dwell_after(moves_, lines_, i).certain;
  const double per_second = move.spindle_speed * teeth;
  const double chip = -move.direction(0).dot(axis_) * move.feed / per_second;  // may_cut has seen to both
  const cutting::EndCoefficients k = job_.material.end.value_or(cutting::end_as_sides(job_.material));
  if (cutting::is_ball(job_.cutter_of(move.tool))) {  // these coefficients are not those of its tip
    out.ball = true;
    out.remaining = end.held_back;
    out.distance = std::hypot(out.remaining, end.aside);
    return out;
  }
  const double thrust = k.kae + k.kac * chip;
  const double stays = thrust > 0 ? std::clamp(k.kae / thrust, 0.0, 1.0) * end.held_back : end.held_back;
  const double falls = end.held_back - stays;
  const double share = falls / (falls + chip);  // q / (1 + q)
  const double passes = std::floor(out.dwell * per_second * (1 + 1e-9));
  const bool rests = passes >= teeth;
  const double left = rests ? std::pow(share, passes) : 1;
  out.remaining = rests ? stays + falls * left : end.held_back;
  // Aside it goes from where the chips hold it to where the edges do; a norm is convex.
  const double there = left * end.aside + (1 - left) * end.at_rest;
  out.distance = std::hypot(out.remaining, there);
  const double aside = there > tube ? 0 : there;  // outside for another reason, which is said
  if (std::hypot(stays + resolution(job_), aside) <= tube) {
    const double enough = falls > resolution(job_) ? std::log(resolution(job_) / falls) / std::log(share) : 0;
    out.needed = std::max(std::ceil(enough), static_cast<double>(teeth)) / per_second;
  }
  return out;
}

namespace {

bool has(const gcode::Block& block, char letter, double value) {
  return std::any_of(block.words.begin(), block.words.end(),
                     [&](const gcode::Word& w) { return w.letter == letter && w.value == value; });
}
template <std::size_t N>
bool has_any_m(const gcode::Block& block, const std::array<int, N>& codes) {
  return std::any_of(block.words.begin(), block.words.end(), [&](const gcode::Word& w) {
    return w.letter == 'M' && std::find(codes.begin(), codes.end(), w.value) != codes.end();
  });
}
/// Whether the tool may stand, for as long as nobody knows, at a word that is carried out before the motion of its
/// block: a spindle that starts, changes or stops, a tool change, an input that is waited for, a
/// program of the machine's builder.
bool may_stand_before(const gcode::Block& block) {
  constexpr double kFirstOfBuilders = 100;  // M100 to M199 run programs of the machine's builder
  return has_any_m(block, std::array{3, 4, 5, 6, 19}) || (has(block, 'M', 66) && !has(block, 'L', 0)) ||
         std::any_of(block.words.begin(), block.words.end(), [](const gcode::Word& w) {
           return w.letter == 'S' || (w.letter == 'M' && w.value >= kFirstOfBuilders);
         });
}
/// The same behind the motion: a stop.
bool may_stand_behind(const gcode::Block& block) {
  return has_any_m(block, std::array{0, 1, 60});
}

}  // namespace

Dwell dwell_after(const LongVector<gcode::Move>& moves, const gcode::Program& lines, std::size_t i) {
  const auto own = static_cast<std::size_t>(moves[i].block);
  std::size_t next = i + 1;
  while (next < moves.size() && !(moves[next].length() > 0)) ++next;
  const std::size_t to = next < moves.size() ? static_cast<std::size_t>(moves[next].block) : lines.blocks.size();
  Dwell dwell;
  constexpr double kAnyTime = 1;  // s: how long is not known, so none of it is certain
  if (to != own && may_stand_behind(lines.blocks[own])) dwell.possible += kAnyTime;
  for (std::size_t b = own + 1; b <= to && b < lines.blocks.size(); ++b) {
    const gcode::Block& block = lines.blocks[b];
    if (block.after_end || has(block, 'M', 2) || has(block, 'M', 30)) break;
    if (may_stand_before(block) || (b < to && may_stand_behind(block))) dwell.possible += kAnyTime;
    if (has(block, 'M', 5)) break;  // no tooth cuts any more
    if (!has(block, 'G', 4)) continue;
    for (const gcode::Word& w : block.words) {
      if (w.letter != 'P') continue;
      dwell.possible += w.value;
      if (!block.optional) dwell.certain += w.value;
    }
  }
  return dwell;
}

void HeldBack::rest(std::size_t i, const Vec3& command, const Vec3& by_edges) {
  if (!is_plunge(moves_[i], axis_)) return;
  const auto aside = [&](const Vec3& tip) {
    const Vec3 d = moves_[i].direction(0), off = tip - moves_[i].end;
    return (off - d * d.dot(off)).norm();
  };
  ends_[i].at_rest = std::max(aside(command), aside(by_edges));
}

bool HeldBack::goes_deeper(std::size_t i) const {
  const gcode::Move move = moves_[i];
  const auto deeper = [&](std::size_t j) {
    if (j <= i) return false;
    const gcode::Move& later = moves_[j];
    return (later.end - move.end).dot(axis_) < 0 &&
           (later.point(later.nearest(move.end)) - move.end).norm() < kSamePlace;
  };
  const auto near = near_.find(cell_of(move.end.x(), move.end.y()));
  return (near != near_.end() && std::any_of(near->second.begin(), near->second.end(), deeper)) ||
         std::any_of(long_.begin(), long_.end(), deeper);
}

std::uint64_t HeldBack::cell_of(double x, double y) {
  const auto index = [](double v) {
    return static_cast<std::uint32_t>(static_cast<std::int64_t>(std::floor(v / kCell)));
  };
  return (std::uint64_t{index(x)} << 32) | index(y);
}

void HeldBack::find_plunges() {
  constexpr double kMostCells = 64;  // of a plunge that leans
  for (std::size_t i = 0; !ends_.empty() && i < moves_.size(); ++i) {
    const gcode::Move& move = moves_[i];
    if (!is_plunge(move, axis_)) continue;
    const double x0 = std::min(move.start.x(), move.end.x()) - kSamePlace,
                 x1 = std::max(move.start.x(), move.end.x()) + kSamePlace,
                 y0 = std::min(move.start.y(), move.end.y()) - kSamePlace,
                 y1 = std::max(move.start.y(), move.end.y()) + kSamePlace;
    if (((x1 - x0) / kCell + 2) * ((y1 - y0) / kCell + 2) > kMostCells) {
      long_.push_back(i);
      continue;
    }
    for (double x = std::floor(x0 / kCell); x <= std::floor(x1 / kCell); ++x) {
      for (double y = std::floor(y0 / kCell); y <= std::floor(y1 / kCell); ++y) {
        near_[cell_of((x + 0.5) * kCell, (y + 0.5) * kCell)].push_back(i);
      }
    }
  }
}

}  // namespace polypod::machining
