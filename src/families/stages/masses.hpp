// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "../masses.hpp"
#include "polypod/families/stages/kinematics.hpp"

namespace polypod::machine {

inline std::string no_masses(const Stages&) {
  return "masses of machines in series are not taken yet";
}

}  // namespace polypod::machine
