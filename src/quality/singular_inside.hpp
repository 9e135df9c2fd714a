// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Whether a surveyed workspace holds a pose at which the drives do not hold the tool, and what of it lies beyond such.
#pragma once

#include <optional>

#include "polypod/quality/survey.hpp"

namespace polypod::quality {

struct SingularInside {
  /// A reachable singular pose of type 2 at a point of the survey, or between two neighbours: the determinant of A
  /// (kinematics::hold) has other signs at them, all points that bisection asks for between are reached, and `control`
  /// is 0 but for rounding where it ends. Nothing found proves nothing.
  std::optional<Pose> pose;
  workspace::BeyondSingular beyond;  ///< of the poses that were looked at
};

/// Of many points and directions some are looked at. Nothing of serial arms, and where A is not square. Cost: some
/// 10 us for each of up to 200 000 poses.
SingularInside singular_inside(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options);

}  // namespace polypod::quality
