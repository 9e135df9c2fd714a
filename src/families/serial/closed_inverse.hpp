// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The closed inverse of an arm, whichever it has.
#pragma once

#include <memory>
#include <optional>

#include "polypod/families/serial/cartesian.hpp"
#include "polypod/families/serial/six_joint_inverse.hpp"

namespace polypod::machine {

class CoupledInverse;
class ScaraInverse;

/// At most one of them.
struct ClosedInverse {
  std::optional<WristInverse> five;
  std::optional<SixJointInverse> six;
  std::optional<CartesianInverse> cartesian;
  std::shared_ptr<const ScaraInverse> scara;
  std::shared_ptr<const CoupledInverse> coupled;

  static ClosedInverse of(const SerialArm& arm);
  [[nodiscard]] bool exists() const { return five || six || cartesian || scara || coupled; }
  /// All solutions; of all forms but `five` seen from `reference`, if there is one.
  [[nodiscard]] kinematics::InverseResult solve(const Pose& X_MT, const double* reference = nullptr) const;
};

}  // namespace polypod::machine
