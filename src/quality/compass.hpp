// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The largest value between the points of a survey, by steps along the coordinates.
#pragma once

#include <functional>

#include "polypod/quality/survey.hpp"

namespace polypod::quality {

/// What is looked for: larger is wanted; no number where there is none.
using PoseValue = std::function<double(const Pose& X_MT)>;

/// Steps along x, y, z and, where `turn`, along both angles of the direction, as long as the value grows; each from
/// half the grid's spacing (a quarter of the tilt) to a fiftieth of it, at most 400 values. It stays within the
/// workspace (all required directions are reached), the survey's box and the required directions. Never below the
/// start.
Extreme climb(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options, const Extreme& start,
              bool turn, const PoseValue& value);

}  // namespace polypod::quality
