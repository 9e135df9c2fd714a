// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "polypod/machining/accept.hpp"
#include "polypod/machining/correct.hpp"

namespace polypod::machining {

/// Whether a correction takes so little that others of the same program may be tried.
[[nodiscard]] bool is_quick(const Job& job, const Correction& c);

/// The program unrolled for the other position of block delete: as it is, and with a correction of its own.
Result<std::optional<OtherSwitch>> other_unrolled(const Job& job, const CorrectOptions& options);

/// What would help a correction that does not hold the tube, each tried out: a wider tube, smaller feeds. Cost: as long
/// as some corrections; nothing is tried where one takes long.
std::vector<std::string> remedies_for(const Job& job, const gcode::Program& program, const Accepted& accepted,
                                      const CorrectOptions& options, const Correction& result);

}  // namespace polypod::machining
