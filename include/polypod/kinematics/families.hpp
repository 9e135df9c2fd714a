// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The questions of every family of machine::Families: what dispatch over AnyMachine needs to see.
#pragma once

#include <variant>

#include "polypod/families/delta/parts.hpp"
#include "polypod/families/hexapod/parts.hpp"
#include "polypod/families/own/parts.hpp"
#include "polypod/families/parallel/parts.hpp"
#include "polypod/families/serial/parts.hpp"
#include "polypod/families/stages/parts.hpp"
#include "polypod/machine/any_machine.hpp"

namespace polypod::kinematics {

/// Whether the inverse of a machine is a search, which may leave solutions out; else all are known.
inline bool searches(const machine::AnyMachine& machine) {
  return std::visit(
      [](const auto& m) {
        if constexpr (requires { has_closed_inverse(m); }) return !has_closed_inverse(m);
        return false;
      },
      machine);
}

}  // namespace polypod::kinematics
