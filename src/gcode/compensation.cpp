// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Cutter radius compensation (G40, G41, G42, G41.1, G42.1), as LinuxCNC 2.9 does it; its rules were found with rs274.
//
// Let r be the radius of the tool, and P the programmed point. The tool ends a move at C, beside P by r, square to the
// end of the move. The next move changes that:
// - an inside corner moves the end to where the two compensated paths meet;
// - at an outside corner the tool goes round P on an arc of radius r (G0: straight);
// - a joint of less than 0.05 rad changes nothing: the next move begins at C.
// So a move waits until the next one is known, and with it what stands between the two. The first move goes from where
// the tool is to C; an arc gets a new centre, on the line through its end and its programmed centre.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "engine.hpp"
#include "polypod/core/units.hpp"
#include "words.hpp"

namespace polypod::gcode {
namespace {

constexpr double kPi = std::numbers::pi;
/// Joints are tangent, and turns are back, within this angle, rad (found by bisection with rs274).
constexpr double kTangent = 0.05;
/// By how much rs274 lets the sweep of an arc grow, rad: a number of its length tolerance, in mm or in inches.
constexpr double kSweepMm = 0.0254;
constexpr double kSweepInch = 0.001;
/// The least cosine between the chord of an entry arc and the radius at its end; below it the arc is a line.
constexpr double kLeastEntryCosine = 1e-4;
/// rs274 takes the diameters of its tool table over a number for mm in an inch that has 14 digits: entry moves of just
/// the radius are long enough.
constexpr double kTable = 25.4 * 0.039370078740157;
/// By how much the radii at start and end of an arc may differ, and its sweep may grow, in a program that is
/// unrolled: as `interpret` has it; and rad.
constexpr double kSpiralMm = 0.02 * std::numbers::sqrt2;
constexpr double kSpiralInch = 0.002 * std::numbers::sqrt2;
constexpr double kSpiralShare = 1e-3;
constexpr double kSweepGrowth = 0.1;
/// A tool number beyond this is none.
constexpr double kLargestTool = 99999;

/// An angle in (-pi, pi].
double within_turn(double angle) {
  angle = std::remainder(angle, 2 * kPi);
  return angle <= -kPi ? kPi : angle;
}
/// An angle in (0, 2 pi].
double positive(double angle) {
  angle = std::fmod(angle, 2 * kPi);
  if (angle < 0) angle += 2 * kPi;
  return angle < 1e-9 ? angle + 2 * kPi : angle;
}

using Point = std::array<double, 2>;

double sweep_between(const Point& centre, const Point& from, const Point& to, int turns) {
  const double a = std::atan2(from[1] - centre[1], from[0] - centre[0]);
  const double b = std::atan2(to[1] - centre[1], to[0] - centre[0]);
  return positive(turns > 0 ? b - a : a - b);
}
Point from_centre(const Point& centre, double radius, double angle) {
  return {centre[0] + radius * std::cos(angle), centre[1] + radius * std::sin(angle)};
}
double distance(const Point& a, const Point& b) {
  return std::hypot(a[0] - b[0], a[1] - b[1]);
}

}  // namespace

/// What LinuxCNC refuses while compensation is on.
Status Engine::judge_compensated(bool begins) const {
  const bool ends = one_of('G', 400) >= 0;  // before length offset, work offset, path mode, retract mode, motion
  struct Bad {
    char letter;
    int from;
    int to;
    bool also_beside_end;  // it acts before a G40 of its block
    std::string_view what;
  };
  constexpr std::array kBad{
      Bad{'G', 410, 421, false, "compensation is on already"},
      Bad{'M', 60, 60, true, "a tool change"},
      Bad{'M', 610, 610, true, "a new tool number"},
      Bad{'M', 480, 530, true, "a switch of overrides"},
      Bad{'M', 620, 680, true, "an input or output"},
      Bad{'G', 180, 190, true, "another plane"},
      Bad{'G', 430, 431, false, "a tool length"},
      Bad{'G', 490, 490, false, "a tool length"},
      Bad{'G', 540, 593, false, "another work offset"},
      Bad{'G', 610, 611, false, "another path mode"},
      Bad{'G', 640, 640, false, "another path mode"},
      Bad{'G', 980, 990, false, "another retract mode"},
      Bad{'G', 280, 301, false, "a place of the machine"},
      Bad{'G', 520, 530, false, "other coordinates"},
      Bad{'G', 920, 923, false, "other coordinates"},
      Bad{'G', 730, 740, false, "a cycle"},
      Bad{'G', 810, 890, false, "a cycle"},
      Bad{'G', 382, 385, false, "a probing move"},
      Bad{'G', 50, 53, false, "a spline"},
  };
  for (const Word& word : block_->words) {
    if (word.letter != 'G' && word.letter != 'M') continue;
    const int code = code_of(word);
    const bool unit = !begins && word.letter == 'G' && ((code == 200 && !inches_) || (code == 210 && inches_));
    for (const Bad& bad : kBad) {
      if (word.letter != bad.letter || code < bad.from || code > bad.to || (ends && !bad.also_beside_end)) continue;
      if (begins && (bad.also_beside_end || bad.from == 410)) continue;  // they act before it
      return error(
          word.column, "GC172",
          fmt::format("{}{} while cutter radius compensation is on: {}", word.letter, number(word.value, 1), bad.what),
          "write G40 and a line behind the contour before it");
    }
    const int l = find('L') != nullptr ? whole(*find('L')).value_or(-1) : -1;
    const int p = find('P') != nullptr ? whole(*find('P')).value_or(-1) : 0;
    const bool system = code == 100 && word.letter == 'G' && !ends && (l == 2 || l == 20) && (p == 0 || p == active_);
    if (unit || system) {
      return error(word.column, "GC172",
                   fmt::format("{}{} while cutter radius compensation is on: {}", word.letter, number(word.value, 1),
                               unit ? "another unit" : "other coordinates"),
                   "write G40 and a line behind the contour before it");
    }
  }
  const bool acts = axis_words() && one_of('G', 0, 10, 20, 30, 800) < 0 && is_cycle(motion_);
  if (!ends && acts) {
    return error(1, "GC172", "a cycle while cutter radius compensation is on",
                 "write G40 and a line behind the contour before it");
  }
  return {};
}

/// The diameter of D, in program units.
Result<double> Engine::cutter_diameter(int g) {
  const Word* d = find('D');
  const int column = g_word(g)->column;
  if (g == 411 || g == 421) {
    if (d != nullptr) return d->value;
    return error(column, "GC170", fmt::format("G{} without D, the diameter", number(g / 10.0, 1)), "add D");
  }
  if (d != nullptr && (d->value < 0 || d->value > kLargestTool || d->value != std::floor(d->value))) {
    return error(d->column, "GC170", fmt::format("D{} is no tool number", d->value),
                 "D of G41 and G42 is a tool number; G41.1 and G42.1 take a diameter");
  }
  const bool spindle = d == nullptr || d->value == 0;
  if (!options_.any_tool) {
    if (spindle) return kTable * lengths(loaded_before_.diameter);
    POLYPOD_ASSIGN(index, index_of(*d));
    return kTable * lengths(options_.tools[index - 1].diameter);
  }
  if (spindle && (stale_tool_ || one_of('M', 60, 610) >= 0)) {
    return error(column, "GC171",
                 "G41 or G42 without D beside M6, behind M61 or behind T0 M6: LinuxCNC takes the diameter of the tool "
                 "before",
                 "name the tool with D, or write it in a block behind M6");
  }
  const int tool = spindle ? spindle_tool_ : static_cast<int>(d->value);
  const auto known = options_.diameters.find(tool);
  double diameter = known != options_.diameters.end() ? known->second : 0;
  if (known == options_.diameters.end() && tool == spindle_tool_) diameter = options_.diameter;
  if (known == options_.diameters.end() && !(diameter > 0)) {
    return error(d != nullptr ? d->column : column, "GC171", fmt::format("the diameter of tool {} is not known", tool),
                 "give the job a [[tool]] of this number, or use G41.1 D with the diameter");
  }
  std::string note = fmt::format(
      "line {}: tool {} is compensated with a diameter of {} mm, that of the job: the tool table must hold the same "
      "when "
      "the program runs",
      written_block_->line, tool, number(units::to_mm(diameter), 4));
  if (std::find(notes_.begin(), notes_.end(), note) == notes_.end()) notes_.push_back(std::move(note));
  return kTable * (inches_ ? units::to_inch(diameter) : units::to_mm(diameter));
}

Status Engine::compensation(int g) {
  rewritten_ = rewritten_ || g != 400;
  if (g == 400) {
    const bool was = compensating();
    POLYPOD_TRY(settle());
    if (was && !entering_) {
      current_ = programmed_;
      left_ = line_is_next_ = true;
    }
    side_ = 0;
    put("COMMENT(\"interpreter: cutter radius compensation off\")");
    return {};
  }
  const int column = g_word(g)->column;
  if (plane_ != Plane::xy) {
    return error(column, "GC121", "cutter radius compensation outside of G17", "compensate in the plane of X and Y");
  }
  POLYPOD_ASSIGN(diameter, cutter_diameter(g));
  const int side = (g < 420 ? 1 : -1) * (diameter < 0 ? -1 : 1);
  if (options_.plain && diameter < 0) {
    return error(find('D') != nullptr ? find('D')->column : column, "GC170",
                 "a negative diameter, which puts the tool on the other side",
                 "use G42 for G41, and a diameter above 0");
  }
  if (options_.plain && diameter > 0 && !(known_[0] && known_[1])) {
    return error(column, "GC169", "cutter radius compensation from a position that is not known",
                 "give X and Y before, in absolute coordinates");
  }
  const bool moves = axis_words() || find('I') != nullptr || find('J') != nullptr;
  if (moves && one_of('M', 60, 610) >= 0) {
    return error(column, "GC121",
                 "cutter radius compensation, a tool change and a move in one block: LinuxCNC 2.9 loses this move",
                 "change the tool in a block before");
  }
  put(side > 0 ? "COMMENT(\"interpreter: cutter radius compensation on left\")"
               : "COMMENT(\"interpreter: cutter radius compensation on right\")");
  side_ = side;
  cutter_radius_ = std::abs(diameter) / 2;
  programmed_ = current_;
  entering_ = true;
  stopped_ = false;
  last_.reset();
  reached_.reset();
  return judge_compensated(true);
}

/// The place of the tool beside p on a path with this heading.
Engine::Point Engine::beside(const Point& p, double heading) const {
  return from_centre(p, cutter_radius_, heading + side_ * kPi / 2);
}

/// Whether a turn (rad, above 0 towards the tool) makes an inside corner. A turn back is one where the tool meets the
/// path from outside of an arc.
bool Engine::is_inside(double turn, bool around) const {
  return std::abs(turn) > kPi - kTangent ? around : turn > 0;
}

void Engine::wait_for(Waiting move) {
  move.line = written_block_ != nullptr ? written_block_->line : 0;
  move.incremental = incremental_;
  move.arc_absolute = arc_absolute_;
  move.rate = inverse_ && !move.rapid ? rate_ : 0;
  if (options_.plain) {
    move.late = late_.size();
    late_.emplace_back();
    motions_.push_back({"", move.late});
  }
  waiting_.push_back(std::move(move));
}

/// The first move, or an arc or line behind its corner: now it waits, and the tool will end beside its end.
Status Engine::enter(Waiting move, double heading, const Point& tool) {
  rewritten_ = true;
  for (std::size_t k = 0; k < 6; ++k) move.named[k] = find(kAxisLetters[k]) != nullptr;
  const Axes programmed = move.end;
  move.end[0] = tool[0];
  move.end[1] = tool[1];
  plain_motion_ = move.kind == Waiting::Kind::arc ? (move.turns > 0 ? 3 : 2) : move.rapid ? 0 : 1;
  last_ = move;
  wait_for(std::move(move));
  heading_ = heading;
  programmed_ = programmed;
  current_ = programmed;
  current_[0] = tool[0];
  current_[1] = tool[1];
  entering_ = false;
  stopped_ = false;
  left_ = drawn_back_ = false;
  return {};
}

/// An outside corner before a move: the tool goes to `start`.
Status Engine::corner(double turn, const Point& start, const Axes& end, bool rapid) {
  Waiting round;
  round.kind = rapid ? Waiting::Kind::straight : Waiting::Kind::arc;
  round.end = end;  // A, B and C turn at the corner
  round.end[0] = start[0];
  round.end[1] = start[1];
  round.end[2] = programmed_[2];
  round.centre = {programmed_[0], programmed_[1]};
  round.radius = cutter_radius_;
  round.turns = -side_;
  round.sweep = positive(-turn);
  round.rapid = rapid;
  wait_for(std::move(round));
  return release();
}

Status Engine::compensated_line(const Axes& end, bool rapid) {
  rewritten_ = true;
  const Point from{programmed_[0], programmed_[1]};
  const double dx = end[0] - from[0];
  const double dy = end[1] - from[1];
  Waiting move;
  move.kind = Waiting::Kind::straight;
  move.end = end;
  move.step = {dx, dy};
  move.rapid = rapid;
  if (entering_) {
    if (!(std::hypot(dx, dy) > cutter_radius_)) {
      return error(1, "GC173",
                   fmt::format("the first compensated move is {:.4f} long, not longer than the tool's radius {:.4f}",
                               std::hypot(dx, dy), cutter_radius_),
                   "start farther from the contour");
    }
    move.entry = true;
    const double heading = std::atan2(dy, dx);
    return enter(std::move(move), heading, beside({end[0], end[1]}, heading));
  }
  if (dx == 0 && dy == 0) {
    move.end[0] = current_[0];
    move.end[1] = current_[1];
    for (std::size_t k = 0; k < 6; ++k) move.named[k] = find(kAxisLetters[k]) != nullptr;
    for (std::size_t k = 2; k < 6; ++k) programmed_[k] = current_[k] = end[k];
    plain_motion_ = rapid ? 0 : 1;
    wait_for(std::move(move));
    return {};
  }
  double heading = std::atan2(dy, dx);
  // The signs of zeros come from this very turn.
  if (side_ < 0 && heading < std::atan2(current_[1] - from[1], current_[0] - from[0])) heading += 2 * kPi;
  const double turn = side_ * within_turn(heading - heading_);
  const bool after_arc = last_ && last_->kind == Waiting::Kind::arc;
  const bool around = after_arc && (last_->turns > 0) != (side_ > 0);
  const Point start = beside(from, heading);
  if (std::abs(turn) < kTangent) {
    POLYPOD_TRY(release());
  } else if (is_inside(turn, around && !stopped_)) {  // behind a stop rs274 goes round a turn back, as behind a line
    Point meet{};
    if (!after_arc) {
      const double back = cutter_radius_ * std::tan(turn / 2);
      meet = {current_[0] - back * std::cos(heading_), current_[1] - back * std::sin(heading_)};
    } else {
      // Where the line is h from the centre, seen from the end of the arc: rs274 does not look at the centre itself.
      const Point c = last_->centre;
      const double r = last_->radius;
      const double outer = r + (around ? -cutter_radius_ : cutter_radius_);
      const Point corner_point{c[0] + (current_[0] - c[0]) / r * outer, c[1] + (current_[1] - c[1]) / r * outer};
      const Point s = beside(corner_point, heading);
      const double ux = std::cos(heading);
      const double uy = std::sin(heading);
      const double along = (s[0] - c[0]) * ux + (s[1] - c[1]) * uy;
      const double h = (s[0] - c[0]) * uy - (s[1] - c[1]) * ux;
      if (std::abs(h) > r) {
        return error(1, "GC174", "the tool does not fit between this line and the arc before it",
                     "use a smaller tool, or make the corner wider");
      }
      const double w = std::sqrt((r - h) * (r + h)) * (around ? 1 : -1);
      meet = {s[0] + (w - along) * ux, s[1] + (w - along) * uy};
    }
    POLYPOD_TRY(end_waiting_at(meet));
  } else {
    POLYPOD_TRY(settle());
    POLYPOD_TRY(corner(turn, start, end, rapid));
  }
  return enter(std::move(move), heading, beside({end[0], end[1]}, heading));
}

Status Engine::compensated_arc(const Axes& end, const Point& centre, int turns) {
  rewritten_ = true;
  const int turning = turns > 0 ? 1 : -1;
  const Point from{programmed_[0], programmed_[1]};
  const Point to{end[0], end[1]};
  const bool inner = turning == side_;  // the tool is on the side of the centre
  const double programmed_radius = distance(to, centre);
  const double end_angle = std::atan2(to[1] - centre[1], to[0] - centre[0]);
  const double heading = within_turn(end_angle + turning * kPi / 2);
  Waiting move;
  move.kind = Waiting::Kind::arc;
  move.end = end;
  move.centre = centre;
  move.turns = turns;
  move.radius = inner ? programmed_radius - cutter_radius_ : programmed_radius + cutter_radius_;
  move.sweep = sweep_between(centre, from, to, turns);
  const Point tool = from_centre(centre, move.radius, end_angle);
  if (entering_ && !(distance(from, to) > cutter_radius_)) {
    return error(1, "GC173",
                 fmt::format("the first compensated move leads {:.4f} far, not farther than the tool's radius {:.4f}",
                             distance(from, to), cutter_radius_),
                 "start farther from the contour");
  }
  const auto too_small = [&] {
    return error(
        1, "GC174",
        fmt::format("a tool of radius {:.4f} inside an arc of radius {:.4f}", cutter_radius_, programmed_radius),
        "use a smaller tool, or a larger arc");
  };
  if (inner && programmed_radius <= cutter_radius_) return too_small();
  if (entering_) {
    const double vx = tool[0] - from[0];
    const double vy = tool[1] - from[1];
    const double ux = std::cos(end_angle);
    const double uy = std::sin(end_angle);
    const double along = vx * ux + vy * uy;
    if (std::abs(along) < kLeastEntryCosine * std::hypot(vx, vy)) {
      return error(1, "GC174", "the first compensated arc comes to a line", "enter with a line");
    }
    const double k = (vx * vx + vy * vy) / (2 * along);
    move.centre = from_centre(tool, inner ? k : -k, heading + side_ * kPi / 2);
    move.radius = distance(tool, move.centre);
    move.sweep = sweep_between(move.centre, from, tool, turns);
    move.entry = true;
    if (options_.plain && k < 0) {
      return error(1, "GC175", "the first compensated arc curves to the other side of the contour",
                   "enter with a line, or with an arc of a larger radius");
    }
    return enter(std::move(move), heading, tool);
  }
  const double start_angle = std::atan2(from[1] - centre[1], from[0] - centre[0]);
  double start_heading = within_turn(start_angle + turning * kPi / 2);
  if (side_ < 0 && start_heading < std::atan2(current_[1] - from[1], current_[0] - from[0])) start_heading += 2 * kPi;
  const double turn = side_ * within_turn(start_heading - heading_);
  if (std::abs(turn) < kTangent) {
    POLYPOD_TRY(release());
  } else if (is_inside(turn, !inner)) {
    Point meet{};
    if (last_->kind != Waiting::Kind::arc) {
      // rs274 takes the corner on the circle through the end of the arc.
      const Point s = beside(from_centre(centre, programmed_radius, start_angle), heading_);
      const double ux = std::cos(heading_);
      const double uy = std::sin(heading_);
      const double along = (s[0] - centre[0]) * ux + (s[1] - centre[1]) * uy;
      const double h = (s[0] - centre[0]) * uy - (s[1] - centre[1]) * ux;
      if (std::abs(h) > move.radius) {
        return error(1, "GC174", "the tool does not fit between this arc and the line before it",
                     "use a smaller tool, or make the corner wider");
      }
      const double w = std::sqrt((move.radius - h) * (move.radius + h)) * (inner ? 1 : -1);
      meet = {s[0] + (w - along) * ux, s[1] + (w - along) * uy};
    } else {
      const Point a = last_->centre;
      const double ra = last_->radius;
      const double rb = move.radius;
      const double dx = centre[0] - a[0];
      const double dy = centre[1] - a[1];
      const double d = std::hypot(dx, dy);
      if (d < 1e-12 || d > ra + rb || d < std::abs(ra - rb)) {
        return error(1, "GC174", "the tool does not fit between this arc and the arc before it",
                     "use a smaller tool, or make the corner wider");
      }
      const double u = (d * d + (ra - rb) * (ra + rb)) / (2 * d);
      const double w = std::sqrt(std::max(0.0, (ra - u) * (ra + u)));
      const double side = side_ * ((last_->turns > 0) == (turns > 0) ? w : -w);
      meet = {a[0] + (dx * u - dy * side) / d, a[1] + (dy * u + dx * side) / d};
    }
    POLYPOD_TRY(end_waiting_at(meet));
  } else {
    POLYPOD_TRY(release());
    POLYPOD_TRY(corner(turn, beside(from, start_heading), end, false));
  }
  return enter(std::move(move), heading, tool);
}

/// Where the waiting moves end now. rs274 refuses a line that comes to run backward and an arc that comes to sweep
/// more, unless it is the first move.
Status Engine::end_waiting_at(const Point& p) {
  if (options_.plain && stopped_ && distance(p, tool_place()) > 0) {
    return error(
        1, "GC175",
        fmt::format("a stop (M0, M1, M60) in the inside corner before: LinuxCNC stands {:.4f} beyond the corner",
                    distance(p, tool_place())),
        "move the stop to another block");
  }
  std::optional<Point> at = reached_;
  for (Waiting& call : waiting_) {
    if (call.kind == Waiting::Kind::text) continue;
    if (at) {
      const bool backward = call.kind == Waiting::Kind::straight &&
                            (p[0] - (*at)[0]) * call.step[0] + (p[1] - (*at)[1]) * call.step[1] < 0;
      const bool more = call.kind == Waiting::Kind::arc &&
                        sweep_between(call.centre, *at, p, call.turns) > call.sweep + (inches_ ? kSweepInch : kSweepMm);
      if (backward || more) {
        return error(1, "GC174",
                     fmt::format("the tool does not fit into the inside corner: the {} of line {} is too short for it",
                                 backward ? "line" : "arc", call.line),
                     "use a smaller tool, or make the corner wider");
      }
    }
    call.end[0] = p[0];
    call.end[1] = p[1];
    at = p;
  }
  return release();
}

/// The waiting moves end beside their programmed end.
Status Engine::settle() {
  if (waiting_.empty()) return {};
  return end_waiting_at(tool_place());
}

/// What waits is final.
Status Engine::release() {
  std::vector<Waiting> calls = std::move(waiting_);
  waiting_.clear();
  for (const Waiting& call : calls) {
    switch (call.kind) {
      case Waiting::Kind::text:
        put_now(call.text);
        continue;
      case Waiting::Kind::straight:
        put("STRAIGHT_{}({})", call.rapid ? "TRAVERSE" : "FEED", list(call.end));
        break;
      case Waiting::Kind::arc:
        put("ARC_FEED({:.4f}, {:.4f}, {:.4f}, {:.4f}, {}, {:.4f}, {:.4f}, {:.4f}, {:.4f})", call.end[0], call.end[1],
            call.centre[0], call.centre[1], call.turns, call.end[2], call.end[3], call.end[4], call.end[5]);
        break;
    }
    if (options_.plain) {
      POLYPOD_TRY(judge_path(call));
      late_[call.late].words = compensated_words(call);
    }
    canon_ = call.end;
    reached_ = Point{call.end[0], call.end[1]};
  }
  return {};
}

/// What LinuxCNC does not refuse, but where the tool cuts into the contour.
Status Engine::judge_path(const Waiting& move) const {
  const Point from{canon_[0], canon_[1]};
  const Point to{move.end[0], move.end[1]};
  const auto gouge = [&](std::string message) {
    return error(1, "GC175", fmt::format("line {}: {}; the tool would cut into the contour", move.line, message),
                 "use a smaller tool, or make the corner wider");
  };
  if (move.kind == Waiting::Kind::straight) {
    if ((to[0] - from[0]) * move.step[0] + (to[1] - from[1]) * move.step[1] < 0) {
      return gouge("the compensated line runs backward");
    }
    return {};
  }
  const double r0 = distance(from, move.centre);
  const double r1 = distance(to, move.centre);
  const double difference = std::abs(r0 - r1);
  if (difference > (inches_ ? kSpiralInch : kSpiralMm) && difference > kSpiralShare * std::max(r0, r1)) {
    return gouge(fmt::format("the compensated arc has the radius {:.4f} at its start and {:.4f} at its end", r0, r1));
  }
  const double sweep = sweep_between(move.centre, from, to, move.turns);
  if (sweep > move.sweep + kSweepGrowth || (sweep < 1e-6 && move.sweep > 1e-6)) {
    return gouge("the compensated arc runs the other way");
  }
  return {};
}

std::string Engine::compensated_words(const Waiting& move) const {
  const Axes to = to_plain(move.end);
  const Axes from = to_plain(canon_);
  const bool arc = move.kind == Waiting::Kind::arc;
  std::string text = arc ? (move.turns > 0 ? "G3" : "G2") : move.rapid ? "G0" : "G1";
  for (std::size_t k = 0; k < 6; ++k) {
    if (k > 1 && !move.named[k] && to[k] == from[k]) continue;
    text += fmt::format(" {}{}", kAxisLetters[k],
                        plain_number(move.incremental ? to[k] - from[k] : to[k], move.incremental));
  }
  if (arc) {
    Axes centre = move.end;
    centre[0] = move.centre[0];
    centre[1] = move.centre[1];
    const Axes c = to_plain(centre);
    for (const std::size_t k : {std::size_t{0}, std::size_t{1}}) {
      text +=
          fmt::format(" {}{}", "IJ"[k], plain_number(move.arc_absolute ? c[k] : c[k] - from[k], !move.arc_absolute));
    }
    if (std::abs(move.turns) != 1) text += fmt::format(" P{}", std::abs(move.turns));
  }
  if (move.rate > 0) {
    const double across =
        arc ? sweep_between(move.centre, {canon_[0], canon_[1]}, {move.end[0], move.end[1]}, move.turns) * move.radius
            : distance({canon_[0], canon_[1]}, {move.end[0], move.end[1]});
    const double length = std::hypot(across, move.end[2] - canon_[2]);
    text += " F" + number(length > 0 ? move.rate / length : 1.0, 9);
  }
  return text;
}

}  // namespace polypod::gcode
