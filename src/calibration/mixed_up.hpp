// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What was probably mixed up in readings that no machine near its drawing explains.
#pragma once

#include <string>
#include <vector>

#include "polypod/calibration/calibrate.hpp"

namespace polypod::calibration {

/// "x_mm and y_mm exchanged", "q3 with the other sign", "x_mm, y_mm and z_mm given in inches", "each reading beside the
/// joints of the row before": the one change with which the drawing comes closer to the readings by `closer` at least,
/// by the root mean square distance; empty if there is none, or no coordinates were measured. Frame and target count as
/// given, or by the best rigid motion where the frame is to be found. Cost: 1 + (n + 4) n / 2 poses a row for n joints.
std::string mixed_up(const AnyMachine& nominal, const std::vector<Measurement>& rows, const CalibrationOptions& options,
                     double closer = 10);

}  // namespace polypod::calibration
