// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The M codes that LinuxCNC has, and those that a machine's builder adds.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "polypod/gcode/interpreter.hpp"
#include "polypod/gcode/program.hpp"

namespace polypod::gcode {

/// M words of a block; LinuxCNC takes no more.
inline constexpr int kMostMWords = 4;

/// Modal group of an M code; 0 for those without.
int m_group_of(int m);

/// Whether an M code is LinuxCNC's own; M100 to M199 are its user's.
bool is_own_m(int m);

struct MRefusal {
  std::string_view id;
  std::string why, hint;
};
/// Why an M code is refused: those that switch the controller's kinematics and those that LinuxCNC does not have,
/// unless `meanings` says what they do. M97 to M99 and M70 to M73 are not judged here.
std::optional<MRefusal> refusal_of_m(int m, const std::map<int, MCode>& meanings);

}  // namespace polypod::gcode
