// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "polypod/core/table_text.hpp"
#include "polypod/machine/any_machine.hpp"
#include "polypod/motion/dynamics.hpp"
#include "polypod/motion/vibration.hpp"

namespace polypod::app {

/// A machine that was made from a machine file, as a file: with the masses (`dynamics`) of that one, and of those of
/// its stages, which are no part of its kinematics.
inline std::string machine_file(const machine::AnyMachine& machine, const std::string& made_from) {
  std::string out = machine::to_toml(machine);
  if (const auto read = motion::read_dynamics(made_from, machine); read && *read && (*read)->of_stages) {
    const auto damping = motion::read_damping(made_from);
    return out + "\n" + motion::to_toml(**read, damping ? *damping : std::nullopt);
  }
  const std::string masses = config::table_text(made_from, "dynamics");
  return masses.empty() ? out : out + "\n" + masses;
}

}  // namespace polypod::app
