// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/kinematics/conventions.hpp"

#include <variant>

#include "../families/conventions.hpp"

namespace polypod::kinematics {

std::vector<std::string> conventions(const machine::AnyMachine& machine) {
  return std::visit(
      [](const auto& m) {
        if constexpr (requires { conventions_of(m); }) return conventions_of(m);
        return std::vector<std::string>{};
      },
      machine);
}

}  // namespace polypod::kinematics
