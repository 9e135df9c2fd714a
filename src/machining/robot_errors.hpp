// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a robot is off besides its compliance (SLAV 3.3, the sequence of COMET).
#pragma once

#include <optional>
#include <vector>

#include "polypod/machining/job.hpp"
#include "polypod/machining/simulate.hpp"

namespace polypod::machining {

/// Job::robot_errors along a way, sample after sample. With s_i = +1 or -1, the sense in which joint i moved last (0
/// before it has), each joint lags by its half play and by what its friction winds up:
///   dq_i = -s_i (backlash_i / 2 + c_i friction_i),   e = R_MW^T (J dq + p_signature(q) - p(q)),
/// c_i the compliance of the joint, J the rows of position of the Jacobian, p and p_signature the tip of the machine
/// and of the calibrated one at the same joints. Model: quasi-static, all play behind the drive's encoder.
class RobotErrorsOnWay {
 public:
  explicit RobotErrorsOnWay(const Job& job);
  /// e of the next sample, in W, m; 0 where the pose is out of reach. Cost: one inverse and one Jacobian, 1 us and
  /// more.
  Vec3 at(const Sample& sample);

 private:
  const Job& job_;
  std::vector<double> lag_;  // of each joint, rad or m
  std::vector<int> sense_;
  std::optional<machine::JointVector> last_;
};

}  // namespace polypod::machining
