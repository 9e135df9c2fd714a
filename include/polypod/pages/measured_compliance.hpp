// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Measured compliances beside computed ones over a plane (SLAV Figures 4.6, 4.12).
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "polypod/statics/measured_map.hpp"
#include "polypod/statics/plane.hpp"

namespace polypod::pages {

struct ComplianceMap;

/// A plane in which displacements were measured.
struct MeasuredPlane {
  statics::Plane plane = statics::Plane::xy;
  double at = 0;                    ///< m
  statics::Rectangle rectangle;     ///< of the points in it, m
  std::vector<std::size_t> points;  ///< that lie in it
};

/// The plane, parallel to two axes of M, of the first point (its coordinate within 0.5 mm) in which the points span an
/// area: the first such of xy, xz and yz. Nothing where there is none.
std::optional<MeasuredPlane> measured_plane(const std::vector<statics::MeasuredPoint>& points);
/// Those of the points that lie in the plane; the rectangle is empty (its sides 0) where there are none.
MeasuredPlane measured_in(const std::vector<statics::MeasuredPoint>& points, statics::Plane plane, double at);

/// Measured compliances over the plane of a ComplianceMap.
struct MeasuredCompliance {
  statics::MeasuredMap map;                    ///< from all points
  std::size_t points = 0;                      ///< that it was made from
  std::string files;                           ///< that they stand in, "plane_I.csv, plane_V.csv"
  bool in_plane = true;                        ///< whether any of them lie in the plane
  std::vector<statics::MeasuredPoint> judged;  ///< those of the plane; all of them where none lies in it
  statics::Compared compared;                  ///< with the machine, at the judged points
  std::vector<Mat3> values, deviations;        ///< m/N, at the points of the grid; NaN where the map does not cover
  Mat3 beyond = Mat3::Zero();  ///< share of the grid (0 to 1) where measured and computed are more than two deviations
                               ///< apart, by entry; about 0.05 where the model is right
  std::vector<std::string> doubts{};  ///< of the readings, in words (statics::Judgement)
};

/// What is to stand beside the computed map. Errors: those of MeasuredMap::of; ID111 a measured pose out of reach;
/// AP148 the measured points cover nothing of the map. Cost: n^2 a point of the grid, 10 ms for 1000 of them and 30
/// points.
Result<MeasuredCompliance> measured_over(const ComplianceMap& map, const std::vector<statics::MeasuredPoint>& points);

/// "The joints explain the measured compliances to 0.13 um/N rms, 1.1 times the noise of the readings: ..." (no stop),
/// and the entries that are beyond two deviations on a quarter of the map or more. `plain`: in ASCII.
std::string measured_verdict(const ComplianceMap& map, bool plain);

/// Whether the joints explain the readings: no doubt, their differences are at most 1.5 times the noise of a reading,
/// and no entry is both above 1.5 times its own noise and beyond two deviations on more than a tenth of the map.
bool explained(const MeasuredCompliance& measured);

}  // namespace polypod::pages
