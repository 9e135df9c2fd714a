// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "../masses.hpp"
#include "polypod/families/own/kinematics.hpp"

namespace polypod::machine {

inline std::string no_masses(const Own&) {
  return "the masses of a family of one's own are not known";
}

}  // namespace polypod::machine
