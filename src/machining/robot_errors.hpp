// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a robot is off besides its compliance (SLAV 3.3, the sequence of COMET).
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "polypod/machining/job.hpp"
#include "polypod/machining/simulate.hpp"

namespace polypod::machining {

/// Job::robot_errors along a way, sample after sample:
///   e = R_MW^T (J dq + p_signature(q) - p(q)),
/// J the rows of position of the Jacobian, p and p_signature the tip of the machine and of the calibrated one at the
/// joints q of the drives. Each joint stands anywhere within h_i = backlash_i / 2 + c_i friction_i of its drive, c_i
/// its compliance. Model: quasi-static, all play behind the drive's encoder; the chips are those without e.
class RobotErrorsOnWay {
 public:
  enum class Play {
    taken_up,  ///< dq_i = -s_i h_i, s_i the sense in which the joint moves: what a command must add to get it there
    as_it_is   ///< dq_i of the play operator: the joint stays where it is until its drive has crossed the play
  };
  RobotErrorsOnWay(const Job& job, Play play);
  /// e of the next sample, in W, m; 0 of what is not known there (all_known). Cost: one inverse and one Jacobian, 1 us
  /// and more.
  Vec3 at(const Sample& sample);
  /// Whether every sample so far had joints, and a pose of the signature's machine at them.
  [[nodiscard]] bool all_known() const { return all_known_; }

 private:
  const Job& job_;
  Play play_;
  std::vector<double> half_;  // h of each joint, rad or m
  std::vector<int> sense_;
  std::optional<machine::JointVector> drives_, joints_;  // at the last sample
  bool all_known_ = true;
};

/// The joints whose friction does nothing, because the machine file gives them no compliance, in a sentence; "" for
/// none.
std::string friction_without_effect(const Job& job);

}  // namespace polypod::machining
