// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/path_mode.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "polypod/core/units.hpp"
#include "polypod/machining/simulate.hpp"

namespace polypod::machining {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
/// Shares of the planner. Acceleration across and along an arc: sqrt(1 - 1/4) and 1/2 of the whole.
const double kNormalShare = std::sqrt(0.75);
constexpr double kTangentialShare = 0.5;
/// A blend may take this share of a move's length as its tolerance.
constexpr double kLengthShare = 0.25;
/// The kink of two directions that counts as tangent, in parts of the acceleration.
constexpr double kKink = 0.1;
/// Beyond this turn, rad, the planner stops.
constexpr double kLargestTurn = units::from_deg(178);
/// A block takes at least this many servo periods.
constexpr double kLeastPeriods = 1.02;
/// Directions count as lying in a plane below this sine: rounded coordinates make more than 1e-9.
constexpr double kInPlane = 1e-6;
/// P is kept in single precision.
constexpr double kSinglePrecision = 1 + 1e-6;
constexpr gcode::PathControl kExactStop{gcode::PathMode::exact_stop, 0, 0};

/// A corner of two lines; lengths in m, 0 for no tolerance.
struct LineCorner {
  double turn, tolerance, length_before, length_after;
};
struct Rounding {
  double deviation = 0, speed = 0;
};

/// The radius of the largest circle that touches both moves within the tolerance and half of each move, m.
double largest_circle(const LineCorner& c) {
  const double share = kLengthShare * std::min(c.length_before, c.length_after);
  const double reach = std::min(c.tolerance, share) / std::tan(c.turn / 4);
  return std::min({c.length_before / 2, c.length_after / 2, reach}) / std::tan(c.turn / 2);
}

/// The circular blend: the largest circle that the tolerance and half of each move allow, as fast as its acceleration
/// permits.
Rounding blend_arc(const LineCorner& c, double v, double a) {
  const double half = c.turn / 2, largest = largest_circle(c), d = largest * std::tan(half);
  const double normal = kNormalShare * a;
  const double speed = std::min(std::sqrt(normal * largest), v);
  const double along = speed * std::min(std::sqrt(2 * kTangentialShare * a * d), speed) / (kTangentialShare * a);
  const double radius = std::max(speed * speed / normal, std::min(along / c.turn, largest));
  return {radius * (1 / std::cos(half) - 1), speed};
}

/// The parabolic blend: the next move begins while the one before slows down, each with half the acceleration.
Rounding blend_parabola(const LineCorner& c, double v, double a) {
  const double half = c.turn / 2, each = 0.5 * a;
  const auto reached = [&](double length) { return std::min(std::sqrt(each * length), v); };
  const double before = reached(c.length_before), after = reached(c.length_after);
  double speed =
      std::min({before, after,
                each * std::min({c.length_before / before, c.length_after / after, std::max(before, after) / each})});
  if (std::isfinite(c.tolerance)) speed = std::min(speed, 2 * std::sqrt(each * c.tolerance / std::sin(half)));
  return {speed * speed * std::sin(half) / (4 * each), std::cos(half) * speed};
}

/// What two lines get: the fastest of blend arc, parabolic blend and plain kink, as the planner chooses. `v` is the
/// largest speed there.
Rounding round_lines(const LineCorner& c, double v, const PlannerLimits& limits) {
  const double a = limits.acceleration;
  const double kink = (v / limits.servo_period + a) * 2 * std::sin(c.turn / 2) / a;
  if (kink < kKink) return {0, v};
  if (c.turn > kLargestTurn) return {};
  const Rounding arc = blend_arc(c, v, a), parabola = blend_parabola(c, v, a);
  const double straight = v * kKink / kink;
  // The parabola is compared by half its speed.
  if (arc.speed >= std::max(straight, 0.5 * parabola.speed)) return arc;
  if (straight >= 0.5 * parabola.speed) return {0, straight};
  return parabola;
}

bool is_rapid(const gcode::Move& move) {
  return move.kind == gcode::MoveKind::rapid;
}
bool is_arc(const gcode::Move& move) {
  return move.kind == gcode::MoveKind::arc;
}
bool turns_axes(const gcode::Move& move) {
  return move.axes_start != move.axes_end;
}

Vec3 normal_of(gcode::Plane plane) {
  return Vec3::Unit(plane == gcode::Plane::xy ? 2 : plane == gcode::Plane::zx ? 1 : 0);
}

/// Whether a blend may leave the plane of an arc by more than its tolerance: after an arc that the next move leaves,
/// and at both ends of a helix. (An arc that begins out of the plane of the line before it keeps the tolerance.)
bool leaves_plane(const gcode::Move& before, const gcode::Move& after) {
  const auto off = [](const gcode::Move& arc, const Vec3& direction) {
    return std::abs(direction.dot(normal_of(arc.plane))) > kInPlane;
  };
  const Vec3 out = after.direction(0);
  if (is_arc(before) && (off(before, before.direction(0)) || off(before, out))) return true;
  return is_arc(after) && (off(after, out) || (is_arc(before) && before.plane != after.plane));
}

/// The radius of an arc, m: the smaller one of a spiral; infinity for a line.
double radius_of(const gcode::Move& move) {
  if (!is_arc(move)) return kInfinity;
  const Vec3 normal = normal_of(move.plane);
  const auto radius = [&](const Vec3& p) {
    const Vec3 r = p - move.centre;
    return (r - normal * normal.dot(r)).norm();
  };
  return std::min(radius(move.start), radius(move.end));
}

/// What a parabolic blend leaves at most where an arc is involved, m: while the next move begins, the one before is
/// still under way on its circle, with a quarter of the acceleration. P does not limit it. kCurved is the share of the
/// curvature in the sum of both motions, with a little to spare.
double parabola_with_arcs(double turn, double v, double a, double curvature) {
  constexpr double kCurved = 0.3;
  const double way = v * v / a;
  return way * std::sin(turn / 2) + kCurved * way * way * curvature;
}

/// Whether the planner may fall back to a parabola: where arcs turn over from one sense or plane to another, and where
/// the blend's circle would be larger than an arc's.
bool may_fall_back(const gcode::Move& before, const gcode::Move& after, double circle) {
  const bool over =
      is_arc(before) && is_arc(after) && (before.plane != after.plane || before.clockwise != after.clockwise);
  return over || circle > std::min(radius_of(before), radius_of(after));
}

double largest_speed(const gcode::Move& move, const PlannerLimits& limits, double override) {
  return is_rapid(move) ? limits.velocity : std::min(move.feed * override, limits.velocity);
}

/// Whether the planner comes to a stop between the moves, whatever their directions.
bool stops(const gcode::Move& before, const gcode::Move& after) {
  return before.path.mode == gcode::PathMode::exact_stop || after.stops_before || is_rapid(before) != is_rapid(after) ||
         before.tool != after.tool || before.spindle != after.spindle || before.spindle_speed != after.spindle_speed;
}

/// P of the joint, m; infinity where neither move has one.
double blend_tolerance(const gcode::Move& before, const gcode::Move& after) {
  double tolerance = kInfinity;
  for (const float p : {before.path.blend_tolerance, after.path.blend_tolerance}) {
    if (p > 0) tolerance = std::min(tolerance, static_cast<double>(p));
  }
  return tolerance;
}

/// A block of the time: its length, speed and acceleration along it.
struct TimedBlock {
  double length, speed, acceleration, corner;
};

double block_time(const TimedBlock& block, double from, double to) {
  if (!(block.length > 0)) return 0;
  const double a = block.acceleration;
  const double top = std::min(block.speed, std::sqrt(a * block.length + 0.5 * (from * from + to * to)));
  const double changing = (2 * top * top - from * from - to * to) / (2 * a);
  return (2 * top - from - to) / a + std::max(0.0, block.length - changing) / top;
}

/// The length of each move that the blend arc of a corner takes the place of, m.
double blend_cut(const Corner& c) {
  if (!(c.rounded > 0) || !(c.speed > 0)) return 0;
  const double half = c.turn / 2;
  return c.rounded / (1 / std::cos(half) - 1) * std::tan(half);
}

/// The moves with one path control mode throughout.
template <class Moves>
struct WithMode {
  const Moves& moves;
  gcode::PathControl control;
  [[nodiscard]] std::size_t size() const { return moves.size(); }
  gcode::Move operator[](std::size_t i) const {
    gcode::Move move = moves[i];
    move.path = control;
    return move;
  }
};

}  // namespace

Corner corner(const gcode::Move& before, const gcode::Move& after, const PlannerLimits& limits) {
  const double length_before = before.length(), length_after = after.length();
  Corner result;
  if (!(length_before > 0) || !(length_after > 0)) return result;
  const Vec3 in = before.direction(length_before), out = after.direction(0);
  result.turn = std::atan2(in.cross(out).norm(), in.dot(out));
  if (stops(before, after)) return result;

  const double feed_before = largest_speed(before, limits, 1), feed_after = largest_speed(after, limits, 1);
  const double v =
      std::max(largest_speed(before, limits, limits.feed_override), largest_speed(after, limits, limits.feed_override));
  const double tolerance = blend_tolerance(before, after);
  const LineCorner lines{result.turn, tolerance, length_before, length_after};
  const Rounding rule = round_lines(lines, v, limits);
  result.speed = std::min({rule.speed, feed_before, feed_after});
  if (before.path.mode == gcode::PathMode::exact_path) {
    // What is tangent is run through; at every other end it stops.
    if (rule.deviation > 0 || rule.speed < v) result.speed = 0;
    return result;
  }

  const bool leaves = leaves_plane(before, after);
  const double merged = std::max(before.path.naive_cam_tolerance, after.path.naive_cam_tolerance);
  const double shorter = kLengthShare * std::min(length_before, length_after);
  result.deviation = result.rounded = rule.deviation;
  result.bound = is_arc(before) || is_arc(after) || feed_before != feed_after;
  // Nor does a blend begin farther from the corner than the way on which the planner slows down for it.
  const double way =
      v * v / limits.acceleration * std::max(1.0, std::tan(std::min(result.turn, kLargestTurn) / 2) / kNormalShare);
  if (leaves && rule.deviation > 0) result.deviation = 2 * std::min({tolerance, shorter, way});
  if (rule.deviation > 0 && may_fall_back(before, after, largest_circle(lines))) {
    const double curvature = 1 / radius_of(before) + 1 / radius_of(after);
    const double parabola = parabola_with_arcs(result.turn, v, limits.acceleration, curvature);
    result.deviation = std::max(result.deviation, std::min(parabola, 2 * shorter));
  }
  if (turns_axes(before) || turns_axes(after)) {
    result.bound = true;
    result.deviation = std::min(tolerance, shorter);
  }
  if (merged > 0 && !is_rapid(before)) {
    // Merged lines are longer and turn more than their blocks.
    result.bound = true;
    const double rounded = std::isfinite(tolerance)
                               ? tolerance
                               : round_lines({kLargestTurn, kInfinity, kInfinity, kInfinity}, v, limits).deviation;
    result.deviation = (leaves ? 2 : 1) * rounded + merged;
  }
  return result;
}

namespace {

template <class Moves>
LongVector<Corner> corners_in(const Moves& moves, const PlannerLimits& limits) {
  LongVector<Corner> result(moves.size());
  std::size_t last = moves.size();
  for (std::size_t i = 0; i < moves.size(); ++i) {
    if (!(moves[i].length() > 0)) continue;
    if (last < moves.size()) result[last] = corner(moves[last], moves[i], limits);
    last = i;
  }
  return result;
}

template <class Moves>
double time_of(const Moves& moves, const PlannerLimits& limits) {
  const LongVector<Corner> joints = corners_in(moves, limits);
  LongVector<TimedBlock> blocks;
  double time = 0, cut = 0;  // cut: what the last corner's blend takes of the move after it, m
  for (std::size_t i = 0; i < moves.size(); ++i) {
    const gcode::Move& move = moves[i];
    const double length = move.length();
    if (!(length > 0)) continue;
    const double a = limits.acceleration * (is_arc(move) ? kTangentialShare : 1);
    double speed = std::min(largest_speed(move, limits, 1), length / (kLeastPeriods * limits.servo_period));
    if (is_arc(move)) speed = std::min(speed, std::sqrt(kNormalShare * limits.acceleration * radius_of(move)));
    if (!(speed > 0)) continue;
    const double begin = std::min(cut, length / 2), end = std::min(blend_cut(joints[i]), length / 2);
    cut = end;
    if (end > 0) time += end * joints[i].turn / std::tan(joints[i].turn / 2) / joints[i].speed;
    blocks.push_back({length - begin - end, speed, a, joints[i].speed});
  }
  // The speed at the end of each block: what the corner allows, what can be stopped from, what is reached.
  const std::size_t n = blocks.size();
  LongVector<double> end(n + 1, 0);  // end[i + 1] after block i; at rest before the first and after the last
  for (std::size_t i = n; i-- > 1;) {
    const double stopped = std::sqrt(end[i + 1] * end[i + 1] + 2 * blocks[i].acceleration * blocks[i].length);
    end[i] = std::min({blocks[i - 1].corner, blocks[i - 1].speed, blocks[i].speed, stopped});
  }
  for (std::size_t i = 0; i < n; ++i) {
    end[i + 1] = std::min(end[i + 1], std::sqrt(end[i] * end[i] + 2 * blocks[i].acceleration * blocks[i].length));
    time += block_time(blocks[i], end[i], end[i + 1]);
  }
  return time;
}

/// The smallest P that is in force during the moves, m; infinity where there is none.
template <class Moves>
double least_blend_tolerance(const Moves& moves) {
  double least = kInfinity;
  for (std::size_t i = 0; i < moves.size(); ++i) {
    const gcode::PathControl path = gcode::Move(moves[i]).path;
    if (path.mode == gcode::PathMode::continuous && path.blend_tolerance > 0)
      least = std::min(least, static_cast<double>(path.blend_tolerance));
  }
  return least;
}

template <class Moves, class Slack>
PathModeChoice choose_mode(const Moves& moves, const Slack& slack, const PlannerLimits& limits) {
  PathModeChoice choice;
  choice.time_before = time_of(moves, limits);
  const LongVector<Corner> unlimited = corners_in(WithMode<Moves>{moves, {}}, limits);
  double least = kInfinity;
  std::size_t before = 0;
  for (std::size_t i = 0; i < std::min(moves.size(), slack.size()); ++i) {
    const double allowed = slack[i] > 0 ? slack[i] : 0;
    if (!(unlimited[i].deviation > std::min(allowed, kLeastBlendTolerance))) continue;
    std::size_t next = i + 1;
    while (next < moves.size() && !(moves[next].length() > 0)) ++next;
    const double p = next < moves.size() && leaves_plane(moves[i], moves[next]) ? 0.5 * allowed : allowed;
    if (p >= least) continue;
    least = p;
    before = i;
  }
  const double own = least_blend_tolerance(moves);
  if (std::isfinite(std::min(least, own))) {
    constexpr double kStep = 1e-7;  // m, the last decimal that is written
    const double p = std::min(std::floor(least / kStep + 1e-6) * kStep, own);
    choice.control = {gcode::PathMode::continuous, static_cast<float>(p), 0};
    if (p < kLeastBlendTolerance) choice.control = kExactStop;
  }
  if (std::isfinite(least)) {
    choice.limiting = static_cast<int>(before);
    // What P does not limit. Under exact stop nothing deviates.
    const LongVector<Corner> kept = corners_in(WithMode<Moves>{moves, choice.control}, limits);
    for (std::size_t i = 0; i < std::min(kept.size(), slack.size()); ++i) {
      if (!(kept[i].deviation > std::max(slack[i], 0.0) * kSinglePrecision)) continue;
      if (choice.not_kept.empty()) choice.limiting = static_cast<int>(i);
      choice.not_kept.push_back(static_cast<int>(i));
    }
    if (!choice.not_kept.empty()) choice.control = kExactStop;
  }
  choice.time_after = time_of(WithMode<Moves>{moves, choice.control}, limits);
  return choice;
}

}  // namespace

std::vector<Corner> corners(std::span<const gcode::Move> moves, const PlannerLimits& limits) {
  const LongVector<Corner> found = corners_in(moves, limits);
  return {found.begin(), found.end()};
}
LongVector<Corner> corners(const PassMoves& moves, const PlannerLimits& limits) {
  return corners_in(moves, limits);
}

double program_time(std::span<const gcode::Move> moves, const PlannerLimits& limits) {
  return time_of(moves, limits);
}
double program_time(const PassMoves& moves, const PlannerLimits& limits) {
  return time_of(moves, limits);
}

PathModeChoice choose_path_mode(std::span<const gcode::Move> moves, std::span<const double> slack,
                                const PlannerLimits& limits) {
  return choose_mode(moves, slack, limits);
}
PathModeChoice choose_path_mode(const PassMoves& moves, const LongVector<double>& slack, const PlannerLimits& limits) {
  return choose_mode(moves, slack, limits);
}

double shortest_block(double v, const PlannerLimits& limits) {
  return 2 * v * limits.servo_period;
}

std::string path_mode_words(const gcode::PathControl& control, bool inches) {
  if (control.mode == gcode::PathMode::exact_path) return "G61";
  if (control.mode == gcode::PathMode::exact_stop) return "G61.1";
  const auto number = [&](float metres) {
    const double scale = inches ? 1e5 : 1e4, value = inches ? units::to_inch(metres) : units::to_mm(metres);
    constexpr double kSingle = 1e-3;  // of the last decimal: what single precision may have lost
    return fmt::format("{:g}", std::floor(value * scale + kSingle) / scale);
  };
  if (!(control.blend_tolerance > 0) && !(control.naive_cam_tolerance > 0)) return "G64";
  if (!(control.blend_tolerance > 0)) return "G64 Q" + number(control.naive_cam_tolerance);
  return "G64 P" + number(control.blend_tolerance) + " Q" + number(control.naive_cam_tolerance);
}

}  // namespace polypod::machining
