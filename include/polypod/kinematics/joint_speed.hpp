// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How fast joints go along a way and how they accelerate, against what they may.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "polypod/kinematics/any_machine.hpp"

namespace polypod::kinematics {

/// The fastest that a joint goes by the machine's own data, rad/s or m/s; infinite where it does not say.
double speed_limit(const AnyMachine& machine, int joint);
/// Of every joint; empty where the machine says none.
std::vector<double> speed_limits(const AnyMachine& machine);

/// A way by what the machine can stand in on it: the solutions at s, 0 <= s <= 1, as seen from joints nearby.
using SolutionsOnWay = std::function<InverseResult(double s, const JointVector& near)>;
/// Those of inverse_near at the poses of a way; both must outlive it.
SolutionsOnWay solutions_on(const AnyMachine& machine, const std::function<Pose(double)>& pose);

/// The joints at the end of a way that begins with the joints `from`: the way is halved down to 1/256 of it until no
/// joint changes by more than `jump` (rad or m) from pose to pose. Nothing where one still does, which is a jump and no
/// quick joint, or where a pose between has no joints within the limits. Cost: one inverse, and up to 510 where the
/// joints hurry.
std::optional<JointVector> followed(const JointVector& from, const SolutionsOnWay& way, double jump);
inline std::optional<JointVector> followed(const AnyMachine& machine, const JointVector& from,
                                           const std::function<Pose(double)>& pose, double jump) {
  return followed(from, solutions_on(machine, pose), jump);
}

/// Of the joints, the one whose speed is the largest share of its limit.
struct FastestJoint {
  int joint = 0;
  double share = 0;  ///< 1: at its limit
  bool judged =
      true;  ///< false: a pose between the ends has no joints within the limits, so that more may be asked for
};

/// Between two poses with the joints `from` and `to`, `seconds` apart: differences over the time. Where a joint comes
/// to a fifth of its limit, or changes by more than 0.05 rad (50 mm), ten pieces of the way are looked at, since joints
/// hurry near singular poses, and those are halved until no joint changes by more in one (up to 20 times); `pose(s)` is
/// the way for 0 <= s <= 1. `limits`: one a joint, rad/s or m/s. Cost: some ns, and ten inverses and more where it
/// looks closer.
FastestJoint fastest_joint(const JointVector& from, const JointVector& to, double seconds,
                           const std::vector<double>& limits, const SolutionsOnWay& way);
inline FastestJoint fastest_joint(const AnyMachine& machine, const JointVector& from, const JointVector& to,
                                  double seconds, const std::vector<double>& limits,
                                  const std::function<Pose(double)>& pose) {
  return fastest_joint(from, to, seconds, limits, solutions_on(machine, pose));
}

/// "30.7 deg", or "512.0 mm" of a slide: of the joint that changes most, in its own number (rad or m).
std::string largest_change(const AnyMachine& machine, const JointVector& change);

/// What a machine breaks where it goes on in its posture from the joints `from`, the limits by name: of the solution
/// whose joints change least. Empty where a joint would change by more than `jump` (rad or m), or nothing is broken.
std::string broken_in_posture(const AnyMachine& machine, const InverseResult& inverse, const JointVector& from,
                              double jump);

/// The first joint beyond its limits, in words: "joint 2 cannot start at 95 deg: its limits are -90 and 90". Empty
/// where the machine can stand there; 1e-9 is left for limits that are written as decimals.
std::string cannot_start(const AnyMachine& machine, const JointVector& joints);

/// "joint 4 would go at 412.1 deg/s where its limit is 180.0"; its speed is limit * share.
std::string too_fast(const AnyMachine& machine, const FastestJoint& fastest, const std::vector<double>& limits);
/// What a slower feed would do: "up to 1230 mm/min it would keep it" for the rate that just keeps the limit, in `unit`.
std::string slower(double rate, const char* unit);

/// A stretch of a way that the tool tip runs at constant speed.
struct Stretch {
  double seconds = 0;
  double length = 0;                 ///< m
  std::function<Pose(double)> pose;  ///< for 0 <= s <= 1
  double tip_acceleration = 0;       ///< m/s^2, that the controller may take at any time along each of x, y and z of M
};

/// Of the joints, the one whose acceleration is the largest share of its limit.
struct HardestJoint {
  int joint = 0;
  double share = 0;     ///< 1: at its limit
  double of_speed = 0;  ///< the part of it that the tip's constant speed asks for
  bool judged = true;   ///< false: a pose between the ends has no joints within the limits
};

/// On a stretch with the joints `from` and `to` at its ends: |q_ss| v^2 + a max(|q_s| / m, |q_x| + |q_y| + |q_z|), with
/// v the speed of the tip, s the way, m the largest of |x_s|, |y_s|, |z_s|, and q_x, q_y, q_z the joints against the
/// position of the tip in M with a kept orientation. q_ss by second differences: of two pieces, and of ten where a
/// joint comes to a fifth of its limit; where a pose between has no joints, `judged` is false. An upper figure: the
/// controller need not accelerate at full speed, nor all axes at once. `limits`: one a joint, rad/s^2 or m/s^2. Cost:
/// one inverse and one Jacobian, and nine inverses more where it looks closer.
HardestJoint hardest_joint(const AnyMachine& machine, const JointVector& from, const JointVector& to,
                           const Stretch& stretch, const std::vector<double>& limits);

/// "joint 4 would accelerate with up to 412 deg/s2 where its limit is 180, 12 of them at the feed and the rest as the
/// controller accelerates with 1000 mm/s2".
std::string too_hard(const AnyMachine& machine, const HardestJoint& hardest, double tip_acceleration,
                     const std::vector<double>& limits);

}  // namespace polypod::kinematics
