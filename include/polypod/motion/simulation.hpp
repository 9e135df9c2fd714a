// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Forward dynamics: how a machine moves under given forces of its drives.
#pragma once

#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "polypod/motion/dynamics.hpp"

namespace polypod::motion {

/// q'' of M(q) q'' + h(q, q') = tau, the equation that drive_forces solves for tau: h is drive_forces at q'' = 0, with
/// gravity, viscous friction and what speeds alone ask. `X` is the pose of the joints q; tau in N or Nm. Nothing where
/// M is not positive definite (something moves without mass), or at a singular pose. Cost: 50 us.
std::optional<JointVector> accelerations(const AnyMachine& machine, const Dynamics& dynamics, const Pose& X,
                                         const JointVector& q, const JointVector& v, const JointVector& tau);

struct SimulationOptions {
  double time = 1;          ///< s
  double interval = 1e-3;   ///< s, between samples; steps end on them
  double step = 0;          ///< s, the longest step, all alike; 0: chosen by the error of each
  double tolerance = 1e-9;  ///< of a step: error of each coordinate against (1e-3 + its size), SI
  std::size_t most_steps = 1'000'000;
  /// tau(t, q, q') in N or Nm; empty: no drive pushes.
  std::function<JointVector(double, const JointVector&, const JointVector&)> forces;
  std::function<bool(double)> progress;  ///< called with the share done; false cancels
};

struct SimulationSample {
  double t = 0;  ///< s
  Pose X;
  JointVector q, speed, acceleration, force;  ///< force: of the drives, without friction
  Energy energy;                              ///< J
  double work = 0;                            ///< J, what drives and viscous friction have brought in since the start
  kinematics::LimitBits violations = 0;
};

/// A limit that the motion passes; it does not stop there.
struct LimitPassed {
  double t = 0;  ///< s, where it is first beyond it, to a thousandth of a step
  std::string limit;
};

/// What a drive did at all steps, between samples as well.
struct DriveExtent {
  double low = std::numeric_limits<double>::infinity(), high = -low;  ///< rad or m
  double speed = 0, acceleration = 0;                                 ///< largest absolute values
};

struct Simulation {
  std::vector<SimulationSample> samples;
  std::vector<LimitPassed> passed;  ///< each limit once
  std::vector<DriveExtent> drives;
  /// J, the largest difference between what the energy has gained and the work at a sample: what the integration lost
  /// or made.
  double drift = 0;
  std::size_t steps = 0, repeated = 0;  ///< taken; and tried again with less
  std::string stopped;                  ///< why it ended before its time, in words; empty where it did not
};

/// The motion from the joints q with speeds v on; `X` is their pose. The joints are what is integrated, by the
/// Runge-Kutta pair of fifth and fourth order of Dormand and Prince; the pose follows by Newton's method on the closure
/// at every evaluation, so that the machine's loops stay closed to rounding, however long it moves. Limits of the
/// joints do not stop it, and bodies do not meet. Errors: MO130 no_dynamics; MO131 dry friction (a drive that stands
/// still holds, which is not simulated); MO132 something moves without mass at the start, or the pose is singular;
/// MO133 a time, interval, step or tolerance that is not above 0, or more than 1e6 samples; MO134 more than
/// `most_steps` steps; MO199 cancelled. A pose that the joints have no more (or a singular one) ends it: `stopped`.
/// Cost: 0.4 ms a step.
Result<Simulation> simulate(const AnyMachine& machine, const Dynamics& dynamics, const Pose& X, const JointVector& q,
                            const JointVector& v, const SimulationOptions& options);

}  // namespace polypod::motion
