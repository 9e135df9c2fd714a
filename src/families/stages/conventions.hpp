// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>

#include <string>
#include <vector>

#include "polypod/families/stages/machine.hpp"
#include "polypod/kinematics/conventions.hpp"

namespace polypod::machine {

inline std::vector<std::string> conventions_of(const Stages& m) {
  std::vector<std::string> out;
  for (std::size_t k = 0; k < m.machines.size(); ++k)
    for (const std::string& said : kinematics::conventions(m.machines[k]))
      out.push_back(fmt::format("stage {}: {}", k + 1, said));
  return out;
}

}  // namespace polypod::machine
