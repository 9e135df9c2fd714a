// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How any machine moves when its tool follows a path of poses: tool and drives over time, what is broken and where.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "polypod/motion/dynamics.hpp"
#include "polypod/motion/pose_path.hpp"
#include "polypod/motion/time_law.hpp"

namespace polypod::motion {

enum class Law {
  constant,  ///< the tip at one speed
  timed,     ///< each stretch in its own time
  fastest    ///< in the least time within the limits
};

/// What the drives can do with their commands (JEL 7.1).
struct Actuators {
  JointVector resolution;  ///< rad or m, the smallest step of each drive; 0: any position
  double interval = 0;     ///< s, between two commands to one drive
  JointVector delay;       ///< s, between a command and when it is carried out
  bool staggered = false;  ///< the drives get their commands one after the other, spread over the interval
};

/// How far the tool is from its path.
struct PathError {
  double largest = 0, mean = 0;  ///< m, from the nearest point of the path (the contour error)
  double largest_lag = 0;        ///< m, from where it should be at that time
  double largest_turn = 0;       ///< rad, of the orientation at that time
};
struct ContourError {
  PathError compensated;     ///< commands are given earlier by the delay
  PathError uncompensated;   ///< they are not
  PathError coarse;          ///< resolution alone
  std::size_t commands = 0;  ///< to each drive
};

struct MoveOptions {
  Law law = Law::constant;
  Profile profile = Profile::linear;  ///< of Law::timed
  double speed = 0;                   ///< m/s, of Law::constant
  PlanLimits limits;                  ///< infinite: not given; of drives empty, or one each
  double step = 1e-3;                 ///< m between judged points of the path, at most
  double turn_step = 0.0175;          ///< rad, the same for turns
  int samples = 1000;                 ///< of the motion over time, equally spaced, at least
  /// Poses whose condition number (kinematics::dexterity) is larger are near-singular; 0: not judged. Of deltas
  /// `singular_distance` takes its place.
  double condition = 1000;
  double singular_distance = 0.010;  ///< m, of deltas (machine::Closeness); 0: not judged
  /// The solution of the inverse at the first pose, by its place in the list; none: the first with which the whole path
  /// can be passed.
  std::optional<std::size_t> start;
  /// Where the joints stand before the path: the first pose is taken as seen from there (inverse_near), which decides
  /// turns and what it leaves free. Empty: not said.
  JointVector before;
  /// Of several with which it can be passed, the one whose largest condition number is the smallest.
  bool best_start = false;
  std::optional<Actuators> actuators;
  std::optional<Dynamics> dynamics;  ///< none: forces are not known
  JointVector force;                 ///< N or Nm, the largest of each drive; empty: not judged
  std::function<bool(double)> progress;
};

/// Tool and drives at one time, derivatives against time, SI.
struct MoveSample {
  double t = 0, s = 0;  ///< s; of the path's parameter
  std::size_t stretch = 0;
  int line = 0;  ///< of the program or file
  Pose X;        ///< the whole pose that the machine has (the target's where it is not reached)
  Vec3 v = Vec3::Zero(), a = Vec3::Zero(), j = Vec3::Zero();  ///< of the tip, m/s, ...
  Vec3 turn = Vec3::Zero();                                   ///< rad/s, angular velocity in M
  bool reached = false;
  bool regular = false;  ///< the drives' derivatives are known
  JointVector q, speed, acceleration, jerk;
  JointVector force;  ///< N or Nm; empty where it is not known
  kinematics::LimitBits violations = 0;
  double condition = 0;
  /// The limit that is met the nearest, and how nearly: 1 where it is met.
  std::string nearest;
  double share = 0;
};

struct MoveViolation {
  double t = 0;       ///< s, where it begins
  double s = 0;       ///< m or rad, of the path's parameter
  double length = 0;  ///< m, of the tip's way up to there
  Vec3 p = Vec3::Zero();
  int line = 0;
  /// "reach", "limit", "singular", "branch", "corner", "tool", "drive"
  std::string kind;
  std::string limit;   ///< "strut 3 above its maximum length", "drive 2 speed", ...
  std::string detail;  ///< with its figures
};

struct MoveDrive {
  bool turns = false;
  double low = kNoLimit, high = -kNoLimit, first = 0, last = 0;  ///< rad or m
  double speed = 0, acceleration = 0, jerk = 0;                  ///< largest absolute values
  std::optional<double> force;                                   ///< N or Nm, likewise
};

/// A solution of the inverse at the first pose, and how far the path can be passed with it.
struct MoveStart {
  std::string branch;
  bool completes = false;
  double reaches = 0;       ///< share of the path up to the first thing that is broken
  std::size_t stretch = 0;  ///< where that is
  double condition = 0;     ///< the largest on the path
  std::string stopped_by;
  bool chosen = false;
};

/// Where the path goes on in one direction, but at another rate.
struct RateJumps {
  std::size_t count = 0;
  double speed = 0, turn = 0;  ///< the largest, of the tip m/s and of its orientation rad/s
};

struct MoveResult {
  double time = 0, length = 0;
  std::vector<MoveSample> samples;
  std::vector<MoveDrive> drives;
  double tool_speed = 0, tool_acceleration = 0, tool_jerk = 0, turn_speed = 0;
  double worst_condition = 0;
  RateJumps jumps;             ///< of Law::constant and Law::timed; where an acceleration is limited also violations
  bool moves_at_once = false;  ///< at its first instant it has its speed already, and at its last still
  std::optional<double> clearance;        ///< m, of deltas
  std::vector<MoveViolation> violations;  ///< in the order of the path; each limit once, where it is first broken
  std::vector<MoveStart> starts;
  std::string branch;
  /// Of Law::fastest: stops on the way, and of each limit the share of the time in which it is the nearest and met to
  /// 1 %.
  std::size_t stops = 0;
  std::vector<std::pair<std::string, double>> binding;
  std::optional<ContourError> contour;
  /// Hz, the lowest natural frequency on the path and those at its start, of machines with masses and compliances.
  std::optional<double> lowest_frequency;
  std::vector<double> frequencies;
  double checked = 0;  ///< number of instants at which limits were checked
  std::vector<std::string> notes;
  [[nodiscard]] bool ok() const { return violations.empty(); }
};

/// Whether the distance from singular poses, not the condition number, says what is near-singular (of deltas).
bool has_clearance(const AnyMachine& machine);

/// With actuators, each drive goes linearly from one commanded position, a multiple of its resolution, to the next; the
/// pose that the tool then has is found by Newton's method on the closure. Contour errors are the largest of 4 instants
/// a command.
/// Errors: MO101 (a speed that is not positive), MO104 (more than 1e6 points), MO118 (more than 2e5 commands), MO114 (a
/// turn on the spot at constant speed), MO115, MO116 (no pose of the path is within reach), MO199 (cancelled).
Result<MoveResult> move(const AnyMachine& machine, const PosePath& path, const MoveOptions& options);

/// Whether a path can be passed at all, with the solution at its start that comes the farthest.
struct PathVerdict {
  bool passes = false;
  double reaches = 0;       ///< share of the path
  double condition = 0;     ///< the largest up to there
  std::size_t stretch = 0;  ///< where it ends
  std::string stopped_by;
};
PathVerdict follow(const AnyMachine& machine, const PosePath& path, const MoveOptions& options);

}  // namespace polypod::motion
