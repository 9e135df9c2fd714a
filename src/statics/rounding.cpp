// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/statics/rounding.hpp"

#include <algorithm>

#include "polypod/kinematics/any_machine.hpp"

namespace polypod::statics {

double rounding_of_tip(const machine::AnyMachine& machine, const Compliance& compliance) {
  constexpr double kOfSize = 1e-9;
  const double length = kinematics::dexterity(machine, compliance.X_MT, compliance.joints).characteristic_length;
  const double tip = compliance.linear().diagonal().maxCoeff();
  const double turn = compliance.C.diagonal().tail<3>().maxCoeff();
  return kOfSize * kOfSize * std::max(tip, length * length * turn);
}

}  // namespace polypod::statics
