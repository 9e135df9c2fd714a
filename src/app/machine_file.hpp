// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "polypod/core/table_text.hpp"
#include "polypod/machine/any_machine.hpp"

namespace polypod::app {

/// A machine that was made from a machine file, as a file: with the masses (`dynamics`) of that one, which are no part
/// of its kinematics.
inline std::string machine_file(const machine::AnyMachine& machine, const std::string& made_from) {
  std::string out = machine::to_toml(machine);
  const std::string masses = config::table_text(made_from, "dynamics");
  return masses.empty() ? out : out + "\n" + masses;
}

}  // namespace polypod::app
