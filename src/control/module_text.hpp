// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The texts that CMake compiles in: parts of the kinematics module, and what drives LinuxCNC for a record.
#pragma once

#include <string_view>

namespace polypod::control {

extern const std::string_view text_of_head_c, text_of_legs_c, text_of_chain_c, text_of_tail_c;
extern const std::string_view text_of_driver_py, text_of_inside_sh;
extern const std::string_view text_of_force_comp, text_of_cut_comp;

}  // namespace polypod::control
