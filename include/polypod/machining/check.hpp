// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Does a program fit a machine? Reach and joint limits along every move, time and length.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/gcode/interpreter.hpp"
#include "polypod/kinematics/joint_speed.hpp"
#include "polypod/machine/any_machine.hpp"
#include "polypod/machining/job.hpp"

namespace polypod::machining {

struct CheckProblem {
  int line = 0;
  /// "reach", "limit", "singular", "branch", "axis" (a turn that the machine does not have), "speed" (of a joint in a
  /// cut), "collision" (`touches`), "empty"
  std::string kind;
  std::string detail;
  bool held = true;  ///< false of "singular": no drive holds the tool there, so that no force can be taken (type 2)
};

struct CheckResult {
  bool ok = false;                     ///< no problem was found in what was judged
  std::vector<CheckProblem> problems;  ///< the first of each kind of each move
  /// Moves of which X, Y and Z are not known from their start on, since the program has not said where the tool is:
  /// "end" (neither where it ends nor its way is judged) or "way" (its end is judged). And "limits", with line 0, where
  /// those of the joints are assumed, "time" (a turn of the tool in G93), and "near singular": where joints whose
  /// speeds have no limits move most, from 0.1 rad on between two points that are looked at.
  std::vector<CheckProblem> not_judged;
  /// Singular poses that the joints follow without a jump, where their speeds are judged: no problems, of each move the
  /// first.
  std::vector<CheckProblem> passed;
  double time = 0;    ///< s, of the feed moves and, at `rapid_speed`, the rapids; without acceleration
  double length = 0;  ///< m
  std::vector<machine::JointRange>
      joints;  ///< smallest and largest value that each joint takes; empty if none was reached
  /// The joint that comes nearest to its limit of CheckOptions::limits in a cut, as share of the limit, and
  /// where.
  kinematics::FastestJoint fastest;
  int fastest_line = 0;              ///< 0: no speed was judged
  kinematics::HardestJoint hardest;  ///< the same of accelerations
  int hardest_line = 0;              ///< 0: no acceleration was judged
  std::vector<std::string> notes;
};

/// What cuts may ask of the joints, one number a joint; empty: not judged. At the programmed feed, point to point; not
/// of rapids, which a controller slows down. Moves that only turn the tool take F as degrees a minute, as in LinuxCNC.
struct MotionLimits {
  std::vector<double> joint_speeds;         ///< rad/s or m/s
  std::vector<double> joint_accelerations;  ///< rad/s^2 or m/s^2
  /// m/s^2, of the tool tip: what the controller may take beside the feed, at any point of a cut along each of x, y and
  /// z of M (see kinematics::hardest_joint).
  double tip_acceleration = 0;
};
/// Those of a job, with the acceleration of its controller.
MotionLimits motion_limits(const Job& job);

struct CheckOptions {
  double step = 1e-3;         ///< m, between checked points
  double turn_step = 0.0175;  ///< rad, the same for A, B and C
  double rapid_speed = 0.1;   ///< m/s, that G0 is counted with
  MotionLimits limits;
  std::string branch;  ///< the posture to begin with, by name; empty: the first within the limits
  /// Where the joints stand before, rad or m: of what the first pose leaves open (a free joint, whole turns) the
  /// nearest to these; empty: not said.
  std::vector<double> start = {};
  bool stop_at_first = false;  ///< only whether there is a problem: no other, no ranges, time or length of the rest
  /// Asked at every point that is reached, with the pose that the machine has there, its joints, whether the way leads
  /// there from the point before, and the T number: which bodies touch, empty where none do. Not asked: no "collision".
  std::function<std::string(const Pose&, const machine::JointVector&, bool, int)> touches;
  std::function<bool(double)> progress;
};

/// Sends the tool along every move without cutting: position and tool axis (A, B, C of the program) through the inverse
/// kinematics, at both ends of each move and between them. The joints follow the branch they are on; a way on which
/// they would have to change branch is a problem of kind "branch". Of moves that begin at an unknown place the way is
/// not judged, and of those that end at one nothing. Cost: about 1 us a point for a closed inverse.
Result<CheckResult> check(const machine::AnyMachine& machine, const Pose& X_MW, const gcode::Program& program,
                          const gcode::Interpretation& interpretation, const CheckOptions& options = {});

/// "the speeds of joints 2 and 3 are not judged: no limits are given", or that none is judged; empty where all of the
/// limits (rad/s or m/s, infinite where not given) are.
std::string without_speed(const std::vector<double>& limits);

/// The postures within the limits at the first point that is judged, by name, the one that `check` takes first; empty
/// where the machine's inverse does not name them.
std::vector<std::string> starting_branches(const machine::AnyMachine& machine, const Pose& X_MW,
                                           const gcode::Interpretation& interpretation);

}  // namespace polypod::machining
