// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How fast joints go along a way, against what they may.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "polypod/kinematics/any_machine.hpp"

namespace polypod::kinematics {

/// Of the joints, the one whose speed is the largest share of its limit.
struct FastestJoint {
  int joint = 0;
  double share = 0;  ///< 1: at its limit
};

/// Between two poses with the joints `from` and `to`, `seconds` apart: differences over the time. Where a joint comes
/// to a fifth of its limit, ten pieces of the way are looked at, since joints hurry near singular poses; `pose(s)` is
/// the way for 0 <= s <= 1. `limits`: one a joint, rad/s or m/s. Cost: some ns, and ten inverses where it looks closer.
FastestJoint fastest_joint(const AnyMachine& machine, const JointVector& from, const JointVector& to, double seconds,
                           const std::vector<double>& limits, const std::function<Pose(double)>& pose);

/// "joint 4 would go at 412.1 deg/s where its limit is 180.0"; its speed is limit * share.
std::string too_fast(const AnyMachine& machine, const FastestJoint& fastest, const std::vector<double>& limits);

}  // namespace polypod::kinematics
