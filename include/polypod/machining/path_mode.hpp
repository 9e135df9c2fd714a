// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a controller's path mode (G61, G61.1, G64) does at the corners of a program, and what it costs in time.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "polypod/core/long_vector.hpp"
#include "polypod/gcode/interpreter.hpp"

namespace polypod::machining {

/// Everything here is the planner of LinuxCNC 2.9 (circular blend arcs), as it was measured: docs/path-modes.md.

struct PlannerLimits {
  double acceleration = 1;   ///< m/s^2, of the weakest axis: the smaller, the rounder the corners
  double velocity = 0.2;     ///< m/s, largest along the path; rapids run at it
  double feed_override = 1;  ///< the largest that the operator may set (MAX_FEED_OVERRIDE): corners are planned for it
  double servo_period = 1e-3;  ///< s
};

/// The joint of two consecutive moves.
struct Corner {
  double turn = 0;       ///< rad, angle between the directions, 0 .. pi
  double deviation = 0;  ///< m, largest distance of a point of the programmed path from where the tip goes
  double rounded = 0;    ///< m, what the rule of two lines says of it, where `deviation` is only a bound: for the time
  double speed = 0;      ///< m/s, the largest in the corner; 0 where the planner stops
  bool bound = false;    ///< `deviation` is not exceeded, but may not be reached
};

/// What the planner does between `before` and `after`, in the modes that are in force during them.
///
/// Two lines under G64, Q = 0, same feed: the blend arc in closed form, which meets recorded motion to 0.2 um. Turn
/// phi, feed v times override, lengths L1, L2, T = min(P, L1/4, L2/4) (without P: min(L1, L2)/4), a_n = sqrt(3)/2 a:
///   d = min(L1/2, L2/2, T / tan(phi/4)),  R_g = d / tan(phi/2),  v_c = min(v, sqrt(a_n R_g)),
///   R = max(v_c^2 / a_n, min(2 v_c min(v_c, sqrt(a d)) / (a phi), R_g)),  deviation R (1 / cos(phi/2) - 1) <= T.
/// Where a parabolic blend or the plain kink is faster the planner takes that. Below about 0.2 deg (kink of a tenth of
/// the acceleration in one servo period) nothing is rounded at full speed.
///
/// Bounds; none of those with arcs was exceeded in 968 recorded corners:
/// - an arc and a line, or two arcs: the same rule;
/// - where two arcs turn in opposite senses or planes, or the circle R_g is larger than an arc: at least
///   v^2 sin(phi/2) / a + 0.3 v^4 / a^2 (1/r1 + 1/r2), at most half the shorter move, whatever P. The planner may fall
///   back to a parabola there that P does not limit (recorded up to 30 P, at P = 5 um and r = 1 mm);
/// - an arc that the next move leaves out of its plane, and both ends of a helix: 2 T (recorded up to 1.66 T);
/// - turning axes A, B, C: T;
/// - different feeds: the rule for the larger one;
/// - Q > 0 merges lines before corners are rounded: P + Q (2 P + Q), whatever the lengths.
/// All of this while the interpreter keeps ahead of the motion.
///
/// No deviation: G61 and G61.1, between rapid and feed, where the tool or the spindle changes or a word waits for the
/// motion (gcode::Move::stops_before), where the planner stops, and
/// to or from a move of no length. Two rapids are rounded as two lines. Cost: about 0.2 us.
Corner corner(const gcode::Move& before, const gcode::Move& after, const PlannerLimits& limits = {});

/// The joint after each move: element i is the one between move i and the next move that has a length, with no
/// deviation after the last and after moves of no length. As many as moves. Cost: linear.
std::vector<Corner> corners(std::span<const gcode::Move> moves, const PlannerLimits& limits = {});

class PassMoves;
LongVector<Corner> corners(const PassMoves& moves, const PlannerLimits& limits = {});

/// The time that the moves take, s: constant acceleration along each block (half of it on arcs) between the speeds in
/// the corners; on a block of length L at most the feed, sqrt(a_n r) on arcs, and L / (1.02 T_servo). Without dwells,
/// tool changes and waiting for the spindle. Within 1 % of recorded runs of the examples, 3 % for a zigzag of short
/// blocks. Cost: linear.
double program_time(std::span<const gcode::Move> moves, const PlannerLimits& limits = {});
double program_time(const PassMoves& moves, const PlannerLimits& limits = {});

/// Below this length, m, a block cannot be run at the speed v (m/s) with certainty: 2 v T_servo.
double shortest_block(double v, const PlannerLimits& limits = {});

/// No P below this is written, m: exact stop takes its place.
inline constexpr double kLeastBlendTolerance = 1e-6;

struct PathModeChoice {
  gcode::PathControl control;
  int limiting = -1;  ///< index of the joint (as in `corners`) that allows the least; -1 if none asks for anything
  std::vector<int> not_kept;  ///< joints with an arc that only an exact stop keeps, not P: why there is one
  double time_before = 0;     ///< s, `program_time` as the moves are
  double time_after = 0;      ///< s, with `control` in force throughout
};

/// The path mode that keeps every joint within its slack: joint i, after move i, may deviate by slack[i] (m; infinity
/// where nothing is asked, for instance in the air; what is not above 0 allows nothing). As many as moves, or one less.
///
/// `G64 P<p> Q0` with p the smallest slack of those joints that G64 without P would round by more than their slack or
/// by more than 1 um, half of it where an arc meets a move out of its plane, rounded down to 0.1 um; G61.1 where that
/// is below 1 um or where P does not keep a joint; G64 without P where no joint asks. p is never above the smallest P
/// that is in force during the moves, which is what their programmer allows. With P the promise does not
/// depend on the limits, but that a joint counts at all does.
PathModeChoice choose_path_mode(std::span<const gcode::Move> moves, std::span<const double> slack,
                                const PlannerLimits& limits = {});
PathModeChoice choose_path_mode(const PassMoves& moves, const LongVector<double>& slack,
                                const PlannerLimits& limits = {});

/// The words that select the mode: "G61", "G61.1", "G64", "G64 P0.0449 Q0"; P and Q in mm, or in inches where G20 is in
/// force, rounded down to 4 (5) decimals.
std::string path_mode_words(const gcode::PathControl& control, bool inches = false);

}  // namespace polypod::machining
