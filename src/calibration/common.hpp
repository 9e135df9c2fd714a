// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Errors that all readings have in common (of frame, target or scale), which a machine's parameters can imitate.
#pragma once

#include <vector>

#include "model.hpp"

namespace polypod::calibration {

/// The common errors that these options do not look for already.
std::vector<std::string> untried(const AnyMachine& machine, const std::vector<Measurement>& rows,
                                 const CalibrationOptions& options);
/// How much of the drawing's squared residuals it explains by itself, by a few steps of Gauss and Newton; rows that
/// `found` calls outliers aside.
CommonChange explained_alone(const AnyMachine& machine, const std::vector<Measurement>& rows,
                             const std::vector<Pose>& seed, const CalibrationOptions& options, const Calibration& found,
                             const std::string& what);
/// Worth a fit beside the machine: it explains half of the readings, or a little of what the machine explains badly.
bool worth_a_fit(const CommonChange& trial, const Calibration& found, const CalibrationOptions& options);
/// The options with this one looked for, too.
CalibrationOptions with_common(CalibrationOptions options, const std::string& what);
/// Fills in what the fits without and with it say.
void compare(const AnyMachine& machine, const std::vector<Measurement>& rows, const std::vector<Pose>& seed,
             const CalibrationOptions& options, const Calibration& without, const Calibration& with,
             CommonChange& trial);
/// The parameters that moved by ten priors (stated, or the default ones) and more, the furthest first.
std::vector<Moved> far_moved(const Calibration& c, const CalibrationOptions& options);
/// Those of them that also stand out: where the parameters moved by two priors and more as a rule, as on a machine that
/// is coarser than usual, twenty priors.
std::vector<Moved> moved_farthest(const Calibration& c, const CalibrationOptions& options);

}  // namespace polypod::calibration
