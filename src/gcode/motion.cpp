// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Lines, arcs, probing, and which motion a block makes.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine.hpp"
#include "polypod/core/units.hpp"
#include "words.hpp"

namespace polypod::gcode {
namespace {

/// rs274's smallest feed under G93, units per minute.
constexpr double kLeastInverseFeed = 0.1;

}  // namespace

/// X and Y by polar words: @ the radius and ^ the angle about the origin, or under G91 their steps from `p`.
void Engine::polar_from(Axes& p) const {
  const Word* radius = find('@');
  const Word* angle = find('^');
  double r = std::hypot(p[0], p[1]);
  double a = units::to_deg(std::atan2(p[1], p[0]));
  if (radius != nullptr) r = radius->value + (incremental_ ? r : 0);
  if (angle != nullptr) a = angle->value + (incremental_ ? a : 0);
  a = a * std::numbers::pi / 180;
  p[0] = r * std::cos(a);
  p[1] = r * std::sin(a);
}

Axes Engine::target() const {
  const Axes& from = programmed();
  Axes end = from;
  if (polar()) {
    polar_from(end);
  }
  for (std::size_t k = 0; k < 6; ++k) {
    const Word* word = find(kAxisLetters[k]);
    // No 0 is added: is printed with its sign.
    if (word != nullptr) end[k] = incremental_ ? from[k] + word->value : word->value;
  }
  return end;
}

Status Engine::motion() {
  POLYPOD_TRY(origin());
  POLYPOD_TRY(shift());
  const bool taken = one_of('G', 100, 280, 300, 431, 520, 920) >= 0;  // whose axis words are no motion
  int named = one_of('G', 0, 10, 20, 30, 50, 51, 52, 53, 382, 383, 384, 385, 730, 740, 810, 820, 830, 840, 850, 860,
                     870, 880, 890);
  if (named < 0) named = one_of('G', 800);  // which does nothing beside another motion
  if (named == 800) {
    motion_ = -1;
    put("COMMENT(\"interpreter: motion mode set to none\")");
    return {};
  }
  if (named == 53) {
    rewritten_ = true;
    return end_nurbs();
  }
  const int before = motion_;
  if (named >= 0) motion_ = named;
  const bool axes = !taken && axis_words();
  const bool centre = motion_ >= 20 && motion_ <= 30 &&
                      std::any_of(block_->words.begin(), block_->words.end(),
                                  [](const Word& w) { return w.letter == 'I' || w.letter == 'J' || w.letter == 'K'; });
  if (motion_ < 0 || taken || (named < 0 && !axes && !centre)) return {};
  if (motion_ == 52) {
    rewritten_ = true;
    return control_point(named >= 0);
  }
  if (g_word(40) != nullptr) rewritten_ = true;  // the dwell gets a block of its own

  if (is_cycle(motion_)) {
    rewritten_ = true;
    if (!is_cycle(before) || new_series_) cycle_level_ = current_[axes_of(plane_)[2]];
    new_series_ = false;
    return cycle(before);
  }
  Axes end = axes ? target() : programmed();
  if (left_) rewritten_ = true;  // the move begins beside the programmed point
  if (motion_ == 0 || motion_ == 10) line_is_next_ = false;
  if (const Word* g53 = g_word(530); g53 != nullptr) {
    rewritten_ = true;
    if (!options_.machine_known) {
      std::string text = fmt::format("G53 G{}", motion_ / 10);
      for (std::size_t k = 0; k < 6; ++k) {
        if (const Word* word = find(kAxisLetters[k]); word != nullptr) {
          text += fmt::format(" {}{}", kAxisLetters[k], number(word->value, 9));
          forget(k);
        }
      }
      plain(text);
      plain_motion_ = motion_ / 10;
      return {};
    }
    Axes machine = to_machine(current_);
    for (std::size_t k = 0; k < 6; ++k) {
      // LinuxCNC takes no rotary offset off.
      if (const Word* word = find(kAxisLetters[k]); word != nullptr)
        machine[k] = word->value - (k < 3 ? length_offset_[k] : 0);
    }
    const Axes place = from_machine(machine);
    end = current_;
    for (std::size_t k = 0; k < 6; ++k) {
      if (find(kAxisLetters[k]) != nullptr || (rotation_ != 0 && k < 2)) end[k] = place[k];
    }
  }
  for (const double x : end) {
    if (!(std::abs(x) <= 1e9)) return error(1, "GC135", "a block that leads beyond 10 km", "check the numbers");
  }
  if (options_.plain && (motion_ == 50 || motion_ == 51) && (!known_[0] || !known_[1])) {
    return error(named >= 0 ? g_word(named)->column : 1, "GC169", "a spline where the position of X or Y is not known",
                 "give X, Y and Z before, in absolute coordinates");
  }
  if (!incremental_) {
    for (std::size_t k = 0; k < 3; ++k) known_[k] = known_[k] || find(kAxisLetters[k]) != nullptr || (k < 2 && polar());
  }
  if (options_.plain && rotation_ != 0 && !incremental_ && (!known_[0] || !known_[1]) &&
      (find('X') != nullptr || find('Y') != nullptr)) {
    return error(find('X') != nullptr ? find('X')->column : find('Y')->column, "GC169",
                 "one of X and Y in turned coordinates, where the other one is not known", "give both");
  }
  switch (motion_) {
    case 0:
      if (compensating()) return compensated_line(end, true);
      traverse(end);
      return {};
    case 10:
      if (inverse_) {
        const Axes& from = programmed();
        const double linear = std::hypot(end[0] - from[0], end[1] - from[1], end[2] - from[2]);
        const double length = linear > 0 ? linear : std::hypot(end[3] - from[3], end[4] - from[4], end[5] - from[5]);
        rate_ = std::max(kLeastInverseFeed, length * value('F'));
        put("SET_FEED_RATE({:.4f})", rate_);
        feed_ = rate_;
      }
      if (compensating()) return compensated_line(end, false);
      feed(end, inverse_);
      return {};
    case 20:
    case 30:
      return arc(end);
    case 50:
    case 51:
      rewritten_ = true;
      motion_ = before;  // a spline leaves the motion mode as it was; cycles behind it are another series
      new_series_ = true;
      return spline(named);
    default:
      rewritten_ = true;
      return probe(end);
  }
}

void Engine::move_to(const Axes& end) {
  current_ = canon_ = end;
  left_ = drawn_back_ = false;
}

void Engine::traverse(const Axes& end) {
  if (options_.text) put(std::string_view(with_list("STRAIGHT_TRAVERSE(", end) += ')'));
  if (options_.plain) plain("G0" + plain_words(end, false));
  plain_motion_ = 0;
  move_to(end);
}

void Engine::feed(const Axes& end, bool by_inverse_time) {
  if (options_.text) put(std::string_view(with_list("STRAIGHT_FEED(", end) += ')'));
  if (options_.plain) {
    std::string text = "G1" + plain_words(end, false);
    if (by_inverse_time) text += " F" + number(value('F'), 9);
    plain(std::move(text));
  }
  plain_motion_ = 1;
  move_to(end);
}

void Engine::dwell(double seconds) {
  put("DWELL({:.4f})", seconds);
  if (options_.plain) plain("G4 P" + number(seconds, 9));
}

Status Engine::arc(const Axes& end) {
  const auto [first, second, normal] = axes_of(plane_);
  constexpr std::string_view kOffsets = "IJK";
  const Axes from = programmed();
  if (line_is_next_) {
    return error(g_word(motion_) != nullptr ? g_word(motion_)->column : 1, "GC176",
                 "an arc is the first move after G40, which LinuxCNC refuses", "leave the contour with a line");
  }
  double c1 = 0;
  double c2 = 0;
  const double turn = motion_ == 20 ? -1 : 1;
  if (options_.checks) {
    const bool any = find(kOffsets[first]) != nullptr || find(kOffsets[second]) != nullptr;
    if (find('R') == nullptr && !any) {
      return error(1, "GC104",
                   fmt::format("G{} without its centre or R; an arc needs its centre or radius", motion_ / 10),
                   "add the centre or the radius");
    }
    if (find('R') != nullptr && (any || find(kOffsets[normal]) != nullptr)) {
      return error(find('R')->column, "GC116", "R beside a centre; an arc takes its centre or its radius",
                   "remove one of them");
    }
    if (find(kOffsets[normal]) != nullptr) {
      return error(find(kOffsets[normal])->column, "GC116", "a centre offset outside the plane",
                   "select the plane of the arc before it");
    }
    if (arc_absolute_ && any && (find(kOffsets[first]) == nullptr || find(kOffsets[second]) == nullptr)) {
      return error(1, "GC117", "an arc under G90.1 with one centre coordinate; both are needed", "add the other one");
    }
    const double p = value('P', 1);
    if (!(p >= 1 && p <= 1e6 && p == std::floor(p))) {
      return error(find('P')->column, "GC118", "P is no number of turns", "P is an integer from 1");
    }
  }
  if (const Word* r = find('R'); r != nullptr) {
    const double dx = end[first] - from[first];
    const double dy = end[second] - from[second];
    const double half = std::hypot(dx, dy) / 2;
    const double radius = std::abs(r->value);
    if (options_.checks) {
      if (half == 0)
        return error(r->column, "GC136", "R with the end at the start", "give a full circle by its centre");
      if (half > radius + inches_tolerance(1.27e-3)) {
        return error(r->column, "GC113", "R is less than half the distance of the ends", "check R and the end");
      }
    }
    // The signs of zeros come from these very functions, so they are used here instead of a square root.
    const double along = radius * std::cos(half >= radius ? std::numbers::pi / 2 : std::asin(half / radius));
    const double side = std::atan2(dy, dx) + (turn * r->value > 0 ? 1 : -1) * std::numbers::pi / 2;
    c1 = (from[first] + end[first]) / 2 + along * std::cos(side);
    c2 = (from[second] + end[second]) / 2 + along * std::sin(side);
  } else {
    c1 = arc_absolute_ ? value(kOffsets[first]) : from[first] + value(kOffsets[first]);
    c2 = arc_absolute_ ? value(kOffsets[second]) : from[second] + value(kOffsets[second]);
    if (options_.checks) {
      const double r0 = std::hypot(from[first] - c1, from[second] - c2);
      const double r1 = std::hypot(end[first] - c1, end[second] - c2);
      const double difference = std::abs(r0 - r1);
      if (r0 < inches_tolerance(1.27e-3) || r1 < inches_tolerance(1.27e-3)) {
        return error(1, "GC115", "an arc of radius 0", "check the centre");
      }
      if (difference > std::numbers::sqrt2 * (inches_ ? 0.002 : 0.02) && difference > 1e-3 * std::max(r0, r1)) {
        return error(1, "GC114", fmt::format("the arc's radius is {:.4f} at its start and {:.4f} at its end", r0, r1),
                     "check the end and the centre; was the block before it removed?");
      }
    }
  }
  const double turns = value('P', 1);
  if (inverse_) {
    const double start_angle = std::atan2(from[second] - c2, from[first] - c1);
    const double end_angle = std::atan2(end[second] - c2, end[first] - c1);
    double sweep = turn * (end_angle - start_angle);
    if (sweep <= 0) sweep += 2 * std::numbers::pi;
    sweep += 2 * std::numbers::pi * (turns - 1);
    const double radius = std::hypot(from[first] - c1, from[second] - c2);
    rate_ = std::max(kLeastInverseFeed, std::hypot(radius * sweep, end[normal] - from[normal]) * value('F'));
    put("SET_FEED_RATE({:.4f})", rate_);
    feed_ = rate_;
  }
  if (compensating()) return compensated_arc(end, {c1, c2}, static_cast<int>(turn * turns));
  put("ARC_FEED({:.4f}, {:.4f}, {:.4f}, {:.4f}, {}, {:.4f}, {:.4f}, {:.4f}, {:.4f})", end[first], end[second], c1, c2,
      static_cast<int>(turn * turns), end[normal], end[3], end[4], end[5]);
  if (options_.plain) {
    if (rotation_ != 0 && plane_ != Plane::xy) {
      rewritten_ = true;
      return error(1, "GC125", "an arc outside of G17 in turned coordinates", "use G17, or G10 L2 with R0");
    }
    Axes centre = from;
    centre[first] = c1;
    centre[second] = c2;
    const Axes p = to_plain(centre);
    const Axes start = to_plain(from);
    std::string text = (motion_ == 20 ? "G2" : "G3") + plain_words(end, true);
    for (const std::size_t k : {first, second}) {
      text += fmt::format(" {}{}", kOffsets[k], plain_number(arc_absolute_ ? p[k] : p[k] - start[k], !arc_absolute_));
    }
    if (turns != 1) text += fmt::format(" P{}", turns);
    if (inverse_) text += " F" + number(value('F'), 9);
    plain(std::move(text));
  }
  plain_motion_ = motion_ / 10;
  move_to(end);
  return {};
}

/// G38.2 to G38.5: a probe that does not trip.
Status Engine::probe(const Axes& end) {
  const int column = g_word(motion_) != nullptr ? g_word(motion_)->column : 1;
  if (!axis_words()) return error(column, "GC128", "a probing move without axes", "name at least one axis");
  if (inverse_) return error(column, "GC128", "a probing move under G93", "use G94");
  if (!options_.machine_known) {
    return error(column, "GC128", "where a probing move ends is not known before it runs", "remove these blocks");
  }
  const double distance = std::hypot(end[0] - current_[0], end[1] - current_[1], end[2] - current_[2]);
  if ((motion_ == 382 || motion_ == 384) && distance < 1e-3) {
    return error(column, "GC128", "a probing move without a length, which LinuxCNC refuses",
                 "start farther from the point");
  }
  put("TURN_PROBE_ON()");
  put("STRAIGHT_PROBE({})", list(end));
  put("TURN_PROBE_OFF()");
  if (options_.plain) plain("G1" + plain_words(end, false));
  plain_motion_ = 1;
  // rs274's machine steps back after it has probed, without a word, along the way that it knows of.
  constexpr double kStepBack_inch = 0.01, kStepBack_mm = 0.254;
  Axes back = end;
  const double way = std::hypot(end[0] - canon_[0], end[1] - canon_[1], end[2] - canon_[2]);
  for (std::size_t k = 0; k < 3 && way > 0; ++k) {
    back[k] -= (inches_ ? kStepBack_inch : kStepBack_mm) * (end[k] - canon_[k]) / way;
  }
  for (std::size_t k = 0; k < 6; ++k) parameter(5061 + static_cast<int>(k)) = end[k];
  parameter(5070) = 0;  // it did not trip
  move_to(back);
  return {};
}

}  // namespace polypod::gcode
