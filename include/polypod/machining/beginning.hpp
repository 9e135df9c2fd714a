// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Where the joints begin a program whose first pose leaves some of them free.
#pragma once

#include <optional>
#include <string>

#include "polypod/gcode/interpreter.hpp"
#include "polypod/kinematics/beginning.hpp"
#include "polypod/machine/any_machine.hpp"
#include "polypod/machining/job.hpp"

namespace polypod::machining {

/// kinematics::look_ahead along the moves from the first place that is known to the next one that is not.
std::optional<kinematics::Beginning> look_ahead(const machine::AnyMachine& machine, const Pose& X_MW,
                                                const gcode::Interpretation& interpretation,
                                                const std::string& posture);

/// Gives the job `start_joints` and the posture behind them where it says no joints and the program begins at a pose
/// that leaves some free. The words for that; empty where nothing was open.
std::string choose_start(const gcode::Interpretation& interpretation, Job& job);

}  // namespace polypod::machining
