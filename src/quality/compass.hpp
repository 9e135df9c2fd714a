// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The largest value between the points of a survey, by steps along the coordinates.
#pragma once

#include <functional>

#include "polypod/quality/survey.hpp"

namespace polypod::quality {

/// A point of a survey, an orientation that is asked there, and what was found: larger is wanted.
struct Seen {
  Mat3 R = Mat3::Identity();
  Vec3 p = Vec3::Zero();
  double value = 0;
};
/// What is looked for; no number where there is none.
using SeenValue = std::function<double(const Mat3& R, const Vec3& p)>;

/// The units in which points lie apart: m, or the spacing of the grid along each coordinate of a task without x, y, z.
Vec3 units_of(const Survey& survey);

/// Steps as long as the value grows, along x, y, z and, where `turn`, both angles of the direction, and slanting to
/// them in pseudo-random directions, so that it follows the boundary of the workspace where the value grows along it
/// (Audet and Dennis, Mesh adaptive direct search, 2006: the workspace is a barrier). Half the grid's spacing (an
/// eighth of the tilt) at first, doubled after a gain and halved after none, down to a thousandth of the spacing, at
/// most 1500 steps. It stays within the workspace (all required directions are reached), the survey's box and the
/// required directions; a step that leaves the workspace is pulled back to its boundary. Never below the start. The
/// same steps in every run.
Seen climb(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options, const Seen& start, bool turn,
           const SeenValue& value);

/// The points of the workspace that lie farthest along its 26 directions of axes and diagonals, climbed to from the
/// farthest points of the grid: ends of the workspace that a grid misses. Cost: 26 climbs without a value.
std::vector<Vec3> tips_of(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options);

}  // namespace polypod::quality
