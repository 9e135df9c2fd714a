// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Pick-and-place cycles within limits, and the motion of drives along a path at constant speed (KOZ 4.3.2), of machines
// that have them: those of the family delta.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "polypod/kinematics/any_machine.hpp"
#include "polypod/motion/dynamics.hpp"
#include "polypod/motion/path.hpp"

namespace polypod::motion {

using machine::AnyMachine;

/// One drive: rad or m, and its derivatives against time.
struct DriveMotion {
  double q = 0, speed = 0, acceleration = 0, jerk = 0;
};

/// Tool and drives at one time.
struct Sample {
  double t = 0;  ///< s
  Motion tool;
  machine::PerArm<DriveMotion> drive;
  bool reached = false;  ///< all drives are known; otherwise they are 0
};

/// Whether the functions below serve a machine; else they fail with MO103.
bool has_cycles(const AnyMachine& machine);

/// Why a path cannot be followed, and where that begins.
struct Problem {
  double t = 0;  ///< s
  double s = 0;  ///< m, along the path; of a cycle the share of its time
  Vec3 X = Vec3::Zero();
  std::string kind;    ///< "limit", "singular", "corner"
  std::string detail;  ///< the limit's name, ...
};

/// Largest absolute values over the samples.
struct Peaks {
  double speed = 0, acceleration = 0, jerk = 0;
};

struct Run {
  double length = 0;  ///< m
  double time = 0;    ///< s
  int arms = 0;
  std::vector<Sample> samples;
  Peaks tool;                      ///< m/s, m/s^2, m/s^3
  machine::PerArm<Peaks> drive{};  ///< rad or m, per s, s^2, s^3
  machine::PerArm<double> low{}, high{};
  /// m, the least distance from a singular pose (machine::Closeness) over the samples, 0 where one is out of reach.
  double clearance = 0;
  std::vector<Problem> problems;  ///< in the order of the path; every kind and limit once, where it is first met
  [[nodiscard]] bool ok() const { return problems.empty(); }
};

struct RunOptions {
  double step = 1e-3;       ///< m between samples along the path, at most
  double singular = 0.010;  ///< m, poses nearer than this to being singular are a problem (KOZ's d_min); 0: none
  double corner = 1e-3;     ///< rad, corners sharper than this are a problem: the tool would have to stop
  bool corners_are_problems = true;
};

/// The tool at constant speed from the first to the last point of a path. What is first out of limits or near-singular
/// is bisected to 1e-6 of a step. Errors: MO101 (a speed that is not positive), MO103 (not a delta), MO104 (more than
/// 1e6 samples).
Result<Run> run(const AnyMachine& machine, const Path& path, double speed, const RunOptions& options = {});

/// Limits of speed, acceleration and jerk.
struct MotionLimits {
  Peaks tool{5, 100, 5000};     ///< m/s, m/s^2, m/s^3
  Peaks drive{12, 250, 20000};  ///< rad or m, per s, s^2, s^3
};

/// Up, over, down: from `from` by `lift` towards the base, over, and down onto `to` (z grows downwards, so the level of
/// the way over is the smaller of the two z less `lift`).
struct Cycle {
  Vec3 from = Vec3::Zero(), to = Vec3::Zero();  ///< m
  double lift = 0.025;                          ///< m, > 0
  /// The way over begins when that much of the lift is left, and the way down when that much of it is left: 0 stops in
  /// the corners. 0 to lift, m.
  double rounding = 0.015;
};

/// A planned cycle: three motions along straight lines that overlap in the corners, each with a jerk that is constant
/// by pieces: displacement d over time T with acceleration for `ramp` T at each end, of which `smooth` at each end
/// changes it.
struct Plan {
  double time = 0;                        ///< s, of the whole cycle one way
  double up = 0, over = 0, down = 0;      ///< s, how long each of the three takes
  double over_start = 0, down_start = 0;  ///< s
  double ramp = 0.5, smooth = 0.5;
  std::string limited_by;     ///< "drive 2 jerk", "tool speed", ...
  double height_at_over = 0;  ///< m, lifted when the way over begins
  [[nodiscard]] Motion tool(const Cycle& cycle, double t) const;
};

/// The fastest cycle of this kind: the shape (ramp, smooth, how long lift and descent take against the way over) is
/// searched for the least time, and time is scaled until one limit is met exactly: speeds go with 1 / time,
/// accelerations with its square, jerks with its cube. Limits are met at 300 times and at each side of every change of
/// jerk. Errors: MO101 (a limit that is not positive), MO103, MO105 (lift or rounding out of range, or from and to at
/// one place), MO106 (some point of the cycle is out of limits or near-singular: message with place and reason).
/// Deterministic. Cost: 0.8 ms.
Result<Plan> plan(const AnyMachine& machine, const Cycle& cycle, const MotionLimits& limits,
                  const RunOptions& options = {});

/// The samples and peaks of a planned cycle, `count` of equal time.
Result<Run> run(const AnyMachine& machine, const Cycle& cycle, const Plan& plan, int count,
                const RunOptions& options = {});

struct PeakForce {
  double force = 0;  ///< N or Nm, absolute
  double t = 0;      ///< s, when
};
/// The largest absolute force (N) or torque (Nm) of each drive over a planned cycle, at 2000 instants of equal time,
/// with what `drive_forces` counts. Of machines whose forces are computed (no_dynamics).
struct LargestForces {
  std::vector<PeakForce> drives;
  std::optional<double> unknown;  ///< s, the first instant at which they are not known: out of reach, or singular
};
LargestForces largest_forces(const AnyMachine& machine, const Dynamics& dynamics, const Cycle& cycle, const Plan& plan);

}  // namespace polypod::motion
