// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What blocks set without moving: feed, speed, spindle, coolant, overrides, plane, unit, path mode, distance mode.
#include <algorithm>

#include "engine.hpp"
#include "words.hpp"

namespace polypod::gcode {

void Engine::feed_and_speed() {
  if (one_of('G', 970) >= 0) put("SET_SPINDLE_MODE(0 0.0000)");
  if (const int mode = one_of('G', 930, 940); mode >= 0) {
    inverse_ = mode == 930;
    put("COMMENT(\"interpreter: feed mode set to {}\")", inverse_ ? "inverse time" : "units per minute");
    put("SET_FEED_MODE(0, 0)");
    if (!inverse_) {
      put("SET_FEED_RATE(0.0000)");
      feed_ = 0;
    }
  }
  // Under G93 the feed that rs274 tells is that of the last move, in units per minute.
  if (const Word* f = find('F'); f != nullptr && !inverse_) {
    put("SET_FEED_RATE({:.4f})", f->value);
    feed_ = f->value;
  }
  if (const Word* s = find('S'); s != nullptr) {
    put("SET_SPINDLE_SPEED(0, {:.4f})", s->value);
    speed_ = s->value;
  }
}

Status Engine::spindle() {
  switch (one_of('M', 30, 40, 50, 190)) {
    case 30:
      turning_ = 1;
      put("START_SPINDLE_CLOCKWISE(0)");
      break;
    case 40:
      turning_ = -1;
      put("START_SPINDLE_COUNTERCLOCKWISE(0)");
      break;
    case 50:
      turning_ = 0;
      put("STOP_SPINDLE_TURNING(0)");
      break;
    case 190:
      turning_ = 0;
      if (find('R') != nullptr) put("ORIENT_SPINDLE(0, {:.4f}, {})", value('R'), integer('P'));
      if (const Word* q = find('Q'); q != nullptr) put("SPINDLE.0.WAIT_ORIENT_COMPLETE({:.4f})", q->value);
      break;
    default:
      break;
  }
  return {};
}

void Engine::switches() {
  switch (one_of('M', 70, 80, 90)) {
    case 70:
      mist_ = true;
      put("MIST_ON()");
      break;
    case 80:
      flood_ = true;
      put("FLOOD_ON()");
      break;
    case 90:
      mist_ = flood_ = false;
      put("MIST_OFF()");
      put("FLOOD_OFF()");
      break;
    default:
      break;
  }
  const bool on = value('P', 1) != 0;
  const std::string_view verb = on ? "ENABLE" : "DISABLE";
  switch (one_of('M', 480, 490, 500, 510, 520, 530)) {
    case 480:
      feed_override_ = speed_override_ = true;
      put("ENABLE_FEED_OVERRIDE()");
      put("ENABLE_SPEED_OVERRIDE(0)");
      break;
    case 490:
      feed_override_ = speed_override_ = false;
      put("DISABLE_FEED_OVERRIDE()");
      put("DISABLE_SPEED_OVERRIDE(0)");
      break;
    case 500:
      feed_override_ = on;
      put("{}_FEED_OVERRIDE()", verb);
      break;
    case 510:
      speed_override_ = on;
      put("{}_SPEED_OVERRIDE(0)", verb);
      break;
    case 520:
      adaptive_feed_ = on;
      put("{}_ADAPTIVE_FEED()", verb);
      break;
    case 530:
      feed_hold_ = on;
      put("{}_FEED_HOLD()", verb);
      break;
    default:
      break;
  }
}

void Engine::set_path_mode() {
  switch (path_mode_) {
    case 610:
      put("SET_MOTION_CONTROL_MODE(CANON_EXACT_PATH)");
      break;
    case 611:
      put("SET_MOTION_CONTROL_MODE(CANON_EXACT_STOP)");
      break;
    default:
      put("SET_MOTION_CONTROL_MODE(CANON_CONTINUOUS, {:.6f})", tolerance_);
  }
}

Status Engine::settings() {
  if (one_of('G', 40) >= 0) put("DWELL({:.4f})", value('P'));
  if (const int g = one_of('G', 170, 180, 190); g >= 0) {
    plane_ = g == 170 ? Plane::xy : g == 180 ? Plane::zx : Plane::yz;
    put_now(fmt::format("SELECT_PLANE(CANON_PLANE_{})", g == 170 ? "XY" : g == 180 ? "XZ" : "YZ"));
  }
  if (const int g = one_of('G', 200, 210); g >= 0) {
    if (inches_ != (g == 200)) {
      inches_ = g == 200;
      const double factor = inches_ ? 1 / kMmPerInch : kMmPerInch;
      scale(current_, factor);
      scale(canon_, factor);
      scale(g92_, factor);
      scale(origin_, factor);
      // As in LinuxCNC 2.9, the tool length, the tolerances in force and the level where a cycle began keep their
      // numbers.
    }
    put_now(inches_ ? "USE_LENGTH_UNITS(CANON_UNITS_INCHES)" : "USE_LENGTH_UNITS(CANON_UNITS_MM)");
  }
  if (const int g = one_of('G', 400, 410, 411, 420, 421); g >= 0) POLYPOD_TRY(compensation(g));
  if (const int g = one_of('G', 430, 431, 490); g >= 0) POLYPOD_TRY(length_offset(g));
  if (const int g = one_of('G', 540, 550, 560, 570, 580, 590, 591, 592, 593); g >= 0) {
    const int next = g >= 591 ? g - 584 : g / 10 - 53;
    if (next == active_) {
      put("COMMENT(\"interpreter: continuing to use same coordinate system\")");
    } else {
      // LinuxCNC 2.9 takes the shift from the parameters here, which a program may set, and not the one in force.
      const Axes g92 = g92_, shift = stored_shift();
      keep_place([&] {
        select(next);
        g92_ = shift;
      });
      g92_ = g92;
      for (std::size_t k = 0; k < 6; ++k) canon_[k] += shift[k] - g92[k];  // where it stands it does know
      active_ = next;
      parameter(5220) = next;
      print_system(active_, true);
      if (next <= 6 && !is_own(next)) plain_system_ = next;
    }
    if (next > 6 || is_own(next)) {
      rewritten_ = true;
      if (next > 6 && !options_.machine_known && !set_[static_cast<std::size_t>(next - 1)]) {
        return error(g_word(g)->column, "GC125",
                     fmt::format("G59.{} has an offset that the job does not hold", next - 6),
                     "use G54 to G59 with the offsets of the job, or set it with G10 L20");
      }
    }
  }
  if (const int g = one_of('G', 610, 611, 640); g >= 0) {
    path_mode_ = g;
    if (g == 640) tolerance_ = std::max(0.0, value('P'));  // below 0 neither is heeded
    set_path_mode();
    if (g == 640) {
      cam_tolerance_ = value('Q', -1) < 0 ? std::max(0.0, value('P')) : value('Q');
      put("SET_NAIVECAM_TOLERANCE({:.4f})", cam_tolerance_);
    }
  }
  if (const int g = one_of('G', 900, 910); g >= 0 && incremental_ != (g == 910)) {
    incremental_ = g == 910;
    put("COMMENT(\"interpreter: distance mode changed to {}\")", incremental_ ? "incremental" : "absolute");
  }
  if (const int g = one_of('G', 901, 911); g >= 0 && arc_absolute_ != (g == 901)) {
    arc_absolute_ = g == 901;
    put("COMMENT(\"interpreter: IJK distance mode changed to {}\")", arc_absolute_ ? "absolute" : "incremental");
  }
  if (const int g = one_of('G', 980, 990); g >= 0) {
    old_level_ = g == 980;
    put("COMMENT(\"interpreter: retract mode set to {}\")", g == 980 ? "old_z" : "r_plane");
  }
  return {};
}

}  // namespace polypod::gcode
