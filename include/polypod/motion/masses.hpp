// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The masses of a machine's parts.
#pragma once

#include <string>
#include <vector>

#include "polypod/motion/dynamics.hpp"

namespace polypod::motion {

struct PartMass {
  std::string part;  ///< "platform", "link 3", "strut, half at the base"
  double mass = 0;   ///< kg; of struts, rods, arms and sliders that of one
};

/// The parts that have a mass.
std::vector<PartMass> part_masses(const Dynamics& dynamics);

}  // namespace polypod::motion
