// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The canned cycles G73, G74 and G81 to G89, in the motions that LinuxCNC makes of them (its G-code reference; what it
// leaves open was found with rs274).
#include <algorithm>
#include <cmath>

#include "engine.hpp"
#include "words.hpp"

namespace polypod::gcode {
namespace {

/// A hole of more steps than this is a slip.
constexpr double kMostSteps = 1e5;
constexpr double kMostRepeats = 1e5;

}  // namespace

Status Engine::cycle(int before) {
  const std::size_t n = plane_ == Plane::xy ? 2 : plane_ == Plane::zx ? 1 : 0;
  const char normal = kAxisLetters[n];
  const Word* named = g_word(motion_);
  const int column = named != nullptr ? named->column : 1;
  const std::string name = fmt::format("G{}", motion_ / 10);
  const auto bad = [&](std::string message, std::string_view hint) {
    return error(column, "GC166", fmt::format("{}: {}", name, message), hint);
  };
  const bool goes_on = before == motion_;
  for (const char c : {'A', 'B', 'C'}) {
    if (find(c) != nullptr) return bad(fmt::format("{} in a cycle", c), "turn before it");
  }
  if (!axis_words()) return bad("no axis is named", "name X, Y or Z");
  if (inverse_) return bad("a cycle under G93", "use G94");
  const Word* r_word = find('R');
  if (r_word == nullptr && !goes_on) return bad("R, the clearance plane, is missing", "add R");
  const Word* bottom_word = find(normal);
  if (bottom_word == nullptr && !goes_on) return bad(fmt::format("{}, the bottom, is missing", normal), "add it");
  const Word* l = find('L');
  if (l != nullptr && motion_ == 740)
    return bad("L in G74, which LinuxCNC does not repeat", "write a block for each hole");
  if (l != nullptr && (!(l->value >= 1) || l->value > kMostRepeats || l->value != std::floor(l->value))) {
    return bad("L is no number of holes", "write an integer from 1");
  }
  if (!known_[n]) {
    return bad(fmt::format("the height of {} before it is not known", normal), "command it in a block before, with G0");
  }
  cycle_r_ = r_word != nullptr ? r_word->value : cycle_r_;
  cycle_bottom_ = bottom_word != nullptr ? bottom_word->value : cycle_bottom_;
  if (const Word* p = find('P'); p != nullptr) {
    if (p->value < 0) return bad("P is negative", "a dwell has a time from 0");
    cycle_p_ = p->value;
  } else if (!goes_on && (motion_ == 820 || motion_ == 860 || motion_ == 880 || motion_ == 890)) {
    return bad("P, the dwell, is missing", "add P");
  }  // G74 and G84 wait as long as the cycle before them
  if (const Word* q = find('Q'); q != nullptr) {
    if (!(q->value > 0)) return bad("Q is no depth of a step", "write Q > 0");
    cycle_q_ = q->value;
  } else if (!goes_on && (motion_ == 730 || motion_ == 830)) {
    return bad("Q, the depth of a step, is missing", "add Q");
  }
  if (motion_ == 870) {
    for (std::size_t k = 0; k < 3; ++k) {
      const Word* offset = find("IJK"[k]);
      if (offset == nullptr && !goes_on) return bad(fmt::format("{} is missing", "IJK"[k]), "add I, J and K");
      if (offset != nullptr) cycle_offsets_[k] = offset->value;
    }
  }
  const double level = cycle_level_;
  const double r = incremental_ ? level + cycle_r_ : cycle_r_;
  const double bottom = incremental_ ? r + cycle_bottom_ : cycle_bottom_;
  if (r < bottom) {
    return bad(fmt::format("R is below {}", normal), fmt::format("R lies above the bottom"));
  }
  if ((motion_ == 730 || motion_ == 830) && (r - bottom) / cycle_q_ > kMostSteps) {
    return bad("Q makes more than 100000 steps", "check Q");
  }
  const bool steps = motion_ == 730 || motion_ == 830;
  lines_ += static_cast<long>((l != nullptr ? l->value : 1) * (steps ? 1 + (r - bottom) / cycle_q_ : 1));
  if (lines_ > options_.most_lines) {
    return error(column, "GC165", fmt::format("the program makes more than {} steps", options_.most_lines),
                 "check L and Q of its cycles, and the conditions of its loops");
  }
  if ((motion_ == 860 || motion_ == 870 || motion_ == 880) && turning_ == 0) {
    return bad("the spindle does not turn", "start it with M3 or M4 before");
  }
  if (motion_ == 840 && turning_ <= 0) return bad("the spindle does not turn clockwise", "start it with M3 before");
  if (motion_ == 740 && turning_ >= 0)
    return bad("the spindle does not turn counterclockwise", "start it with M4 before");
  if ((motion_ == 740 || motion_ == 840) && plane_ != Plane::xy) {
    return error(column, "GC122", fmt::format("{} outside of G17: LinuxCNC 2.9 exchanges its axes there", name),
                 "tap in G17, or post the program with this cycle expanded");
  }
  if (motion_ == 880 && !options_.machine_known) {
    return error(column, "GC122", "G88: the tool is drawn back by hand, nobody knows where to", "use G82, G86 or G89");
  }

  const auto at = [&](double height) {
    Axes p = current_;
    p[n] = height;
    return p;
  };
  const double clear = old_level_ ? std::max(level, r) : r;
  name_axes_ = false;
  if (level < r) traverse(at(r));
  const int mode = path_mode_;
  if (mode != 610) {
    path_mode_ = 610;
    set_path_mode();
    plain("G61");
  }
  const auto start = [&](int sense) {  // of the spindle, above 0 clockwise
    put(sense > 0 ? "START_SPINDLE_CLOCKWISE(0)" : "START_SPINDLE_COUNTERCLOCKWISE(0)");
    plain(sense > 0 ? "M3" : "M4");
  };
  const int count = l != nullptr ? static_cast<int>(l->value) : 1;
  double travel = current_[n] > r ? current_[n] : clear;
  Axes hole = current_;
  for (int i = 0; i < count; ++i) {
    if (polar()) {
      polar_from(hole);
      known_[0] = known_[1] = true;
    }
    for (std::size_t k = 0; k < 3; ++k) {
      const Word* word = k != n ? find(kAxisLetters[k]) : nullptr;
      if (word != nullptr) hole[k] = incremental_ ? hole[k] + word->value : word->value + 0.0;  // no negative zero
      if (word != nullptr && !incremental_) known_[k] = true;
    }
    Axes p = hole;
    p[n] = travel;
    name_axes_ = true;
    traverse(p);
    name_axes_ = false;
    if (travel != r) traverse(at(r));
    const double back = inches_ ? 0.010 : 0.254;
    switch (motion_) {
      case 730:
        for (double depth = r - cycle_q_; depth > bottom; depth -= cycle_q_) {
          feed(at(depth), false);
          traverse(at(depth + back));
        }
        feed(at(bottom), false);
        traverse(at(clear));
        break;
      case 830:
        for (double depth = r - cycle_q_; depth > bottom; depth -= cycle_q_) {
          feed(at(depth), false);
          traverse(at(r));
          traverse(at(depth + back));
        }
        feed(at(bottom), false);
        traverse(at(clear));
        break;
      case 740:
      case 840: {
        const bool overrides = feed_override_;
        const bool speeds = speed_override_;
        const int turning = turning_;
        put("DISABLE_FEED_OVERRIDE()");
        put("DISABLE_SPEED_OVERRIDE(0)");
        plain("M49");
        feed(at(bottom), false);
        put("STOP_SPINDLE_TURNING(0)");
        start(-turning);
        dwell(cycle_p_);
        feed(at(clear), false);
        put("STOP_SPINDLE_TURNING(0)");
        start(turning);
        if (overrides) put("ENABLE_FEED_OVERRIDE()");
        if (speeds) put("ENABLE_SPEED_OVERRIDE(0)");
        if (overrides && speeds) {
          plain("M48");
        } else if (overrides || speeds) {
          plain(overrides ? "M50 P1" : "M51 P1");
        }
        break;
      }
      case 820:
        feed(at(bottom), false);
        dwell(cycle_p_);
        traverse(at(clear));
        break;
      case 850:
        feed(at(bottom), false);
        feed(at(r), false);
        traverse(at(clear));
        break;
      case 860:
        feed(at(bottom), false);
        dwell(cycle_p_);
        put("STOP_SPINDLE_TURNING(0)");
        plain("M5");
        traverse(at(clear));
        start(turning_);
        break;
      case 870: {
        // In beside the hole, across, and the tool cuts upward from the bottom.
        const double middle = incremental_ ? bottom + cycle_offsets_[n] : cycle_offsets_[n];
        const auto beside = [&](double height) {
          const auto [first, second, normal_axis] = axes_of(plane_);
          Axes q = hole;
          q[first] += cycle_offsets_[first];
          q[second] += cycle_offsets_[second];
          q[normal_axis] = height;
          return q;
        };
        const auto above = [&](double height) {
          Axes q = hole;
          q[n] = height;
          return q;
        };
        const auto orient = [&] {
          put("STOP_SPINDLE_TURNING(0)");
          put("ORIENT_SPINDLE(0, 0.0000, {})", turning_ > 0 ? 2 : 3);
          plain("M5");
          plain("M19 R0");
        };
        traverse(beside(r));
        orient();
        traverse(beside(bottom));
        traverse(above(bottom));
        start(turning_);
        feed(above(middle), false);
        feed(above(bottom), false);
        orient();
        traverse(beside(bottom));
        traverse(beside(clear));
        traverse(above(clear));
        start(turning_);
        break;
      }
      case 880:
        feed(at(bottom), false);
        dwell(cycle_p_);
        put("STOP_SPINDLE_TURNING(0)");
        plain("M5");
        put("PROGRAM_STOP()");
        put(turning_ > 0 ? "START_SPINDLE_CLOCKWISE(0)" : "START_SPINDLE_COUNTERCLOCKWISE(0)");
        current_ = at(clear);  // no call draws the tool back
        drawn_back_ = true;
        break;
      case 890:
        feed(at(bottom), false);
        dwell(cycle_p_);
        feed(at(clear), false);
        break;
      default:
        feed(at(bottom), false);
        traverse(at(clear));
    }
    travel = clear;
  }
  if (mode != 610) {
    path_mode_ = mode;
    set_path_mode();
    put("SET_NAIVECAM_TOLERANCE({:.4f})", cam_tolerance_);
    plain(mode == 611 ? "G61.1"
          : tolerance_ > 0
              ? fmt::format("G64 P{} Q{}", plain_number(tolerance_, false), plain_number(cam_tolerance_, false))
              : std::string("G64"));
  }
  return {};
}

}  // namespace polypod::gcode
