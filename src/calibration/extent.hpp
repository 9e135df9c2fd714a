// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Measured places against those of the nominal machine, before anything is fitted.
#pragma once

#include <optional>
#include <vector>

#include "polypod/calibration/measurement.hpp"

namespace polypod::calibration {

/// `seed`: the nominal machine's pose of every row. Errors: CA112 (all places on a line), CA113 (another unit).
Status check_extent(const std::vector<Measurement>& rows, const std::vector<Pose>& seed, const Pose& X_SM,
                    const Pose& X_TR);

/// X_SM that brings the nominal machine's targets nearest to the measured ones (Kabsch), where places were measured.
std::optional<Pose> fitted_frame(const std::vector<Measurement>& rows, const std::vector<Pose>& seed, const Pose& X_TR);

}  // namespace polypod::calibration
