// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The closed inverse of arms with coupled joints, over the one without coupling.
#pragma once

#include <optional>
#include <vector>

#include "closed_inverse.hpp"

namespace polypod::machine {

/// With coupling, row i turns by theta_i = sign_i q_i + offset_i + coupling_i q_c; without, by sign_i u_i + offset_i.
/// So q_i = u_i - sign_i coupling_i q_c, one joint after the other, each in the turn within its range.
class CoupledInverse {
 public:
  /// Nothing where no joint is coupled, a locked row is, or the arm without coupling has no closed inverse.
  static std::optional<CoupledInverse> of(const SerialArm& arm);

  /// All solutions, with the branches of the arm without coupling; seen from `reference`, if there is one. Cost: that
  /// of its inverse and some 0.5 us.
  [[nodiscard]] kinematics::InverseResult solve(const Pose& X_MT, const double* reference = nullptr) const;
  /// The inverse without coupling, whose branches these are.
  [[nodiscard]] const ClosedInverse& without() const { return without_; }

 private:
  struct Joint {
    JointRange range;
    double factor = 0;  ///< sign_i coupling_i
    int of = -1;        ///< the joint that turns it; -1: none
    double shift = 0;   ///< sign_i coupling_i q_c of a row that is locked
    bool turns = true;
  };
  ClosedInverse without_;
  std::vector<Joint> joints_;
};

}  // namespace polypod::machine
