// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Singular and near-singular poses of deltas by two methods on the same points (KOZ 4.5.2.2 and 4.5.2.3).
#pragma once

#include <limits>
#include <vector>

#include "polypod/families/delta/kinematics.hpp"
#include "polypod/workspace/field.hpp"

namespace polypod::workspace {

struct DeltaStudyOptions {
  double step = 0.02;     ///< m, of the grid; 1 to 100 mm
  double d_min = 0.010;   ///< m, of the distances by geometry (the source's choice)
  double h_min = 1e-5;    ///< of |det A| and |det B| (4.42), (4.44) in m (the source prints 1,0^-5)
  double border = 0.020;  ///< m, points at least so far inside count as deep
  int threads = 0;
  std::size_t max_memory = 0;  ///< bytes that the points may take; 0: half of the machine's memory
};

/// One point of the grid within all limits.
struct DeltaPoint {
  Vec3 X = Vec3::Zero();
  machine::Closeness close;
  bool by_geometry = false;     ///< near-singular: a distance below d_min
  bool by_determinant = false;  ///< a determinant below h_min
  bool deep = false;            ///< every point of a sphere of `border` (26 are tried) is within all limits
};

/// Counts of points, of all and of the deep ones.
struct DeltaCounts {
  std::int64_t points = 0;
  std::int64_t geometry = 0, determinant = 0;  ///< near-singular by each method
  std::int64_t both = 0;                       ///< by both
  std::int64_t stretched = 0, folded = 0;      ///< elbow_gap below d_min (type 1), by where the elbow is
  std::int64_t level = 0, flat = 0;            ///< drop, pose_gap below d_min (type 2)
  /// Least distances met, m; infinite without such points: elbows nearer stretched, nearer folded, poses, drop.
  double least_stretched = std::numeric_limits<double>::infinity();
  double least_folded = std::numeric_limits<double>::infinity();
  double least_poses = std::numeric_limits<double>::infinity();
  double least_drop = std::numeric_limits<double>::infinity();
  /// Points on which the methods say the same; their share in percent, 100 without points.
  [[nodiscard]] std::int64_t agree() const { return points - geometry - determinant + 2 * both; }
  [[nodiscard]] double agree_percent() const {
    return points > 0 ? 100.0 * static_cast<double>(agree()) / static_cast<double>(points) : 100.0;
  }
};

struct DeltaStudy {
  std::vector<DeltaPoint> points;  ///< in the order of the grid
  DeltaCounts all, deep;
};

/// Both methods on every point of a grid over the workspace (limits as in Options without bodies). Errors: WS140 (not a
/// delta), WS141 (a step, distance or threshold out of range), WS143 (more points than the memory holds), those of
/// extent(). Deterministic for any number of threads. Cost: 30 us a point.
Result<DeltaStudy> delta_study(const AnyMachine& machine, const DeltaStudyOptions& options = {});

/// The tool points of every combination of `steps` positions of each drive over its range, as the source draws its
/// workspace (KOZ 4.5.1.2): those within all limits whose inverse leads back. Four arms: of the first three. Errors:
/// WS140, WS141 (2 to 200 steps).
Result<std::vector<Vec3>> drive_cloud(const AnyMachine& machine, int steps);

}  // namespace polypod::workspace
