// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A survey in space: the part of a workspace where a number is small enough, as a closed surface.
#pragma once

#include <vector>

#include "polypod/quality/survey.hpp"
#include "polypod/workspace/surface.hpp"

namespace polypod::quality {

/// A survey's grid with a row of points more on every side.
struct SurveyBorder {
  workspace::Field field;   ///< its margin; 0 in the row round a box that the survey was given
  std::vector<int> number;  ///< of each point: its place in Survey::inside, or -1
};
/// Errors: those of workspace::field(), WS130 (a survey with less than 2 points in one direction). Cost: that of
/// workspace::field() without tilts, 15 us a point of the grid.
Result<SurveyBorder> survey_border(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options);

/// The boundary of { p in the workspace : value(p) <= below } by workspace::surface_of; `values` as Quantity::mean,
/// linear along the edges of the grid; `below` may be infinite. Its points lie on the workspace's true boundary, or
/// within 1e-3 of the spacing of a box's, or between the values; edges are cut off within a spacing. Errors: WS131 (no
/// such point).
Result<workspace::Surface> surface_below(const AnyMachine& machine, const SurveyOptions& options,
                                         const SurveyBorder& border, const std::vector<double>& values, double below);

/// Values at other points, e.g. of a surface: trilinear over the corners of the cell that have one; NaN where none has.
std::vector<double> values_at(const SurveyBorder& border, const std::vector<double>& values,
                              const std::vector<Vec3>& points);

}  // namespace polypod::quality
