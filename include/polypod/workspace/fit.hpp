// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Does a task fit a delta, and what would make it fit (KOZ 4.6.2)?
#pragma once

#include <optional>
#include <vector>

#include "polypod/workspace/field.hpp"

namespace polypod::workspace {

/// One point of a task and the boundary of what the machine reaches.
struct PointFit {
  Vec3 X = Vec3::Zero();
  bool fits = false;
  /// m, to the nearest point of the boundary that a search found; infinite where it found none. There may be a nearer
  /// one that the search missed.
  double distance = 0;
  Vec3 boundary = Vec3::Zero();  ///< that point
  double certain = 0;            ///< m: every point nearer than this fits, proven; 0 where nothing was proven
  int limit = 0;  ///< of a point that fits: which is met at that boundary; otherwise: the most broken one
};

/// Values of one change with which every point fits: low..high, and the one nearest to no change.
struct FitRange {
  double low = 0, high = 0, nearest = 0;
};

struct Fit {
  std::vector<PointFit> points;
  bool fits = false;
  std::optional<FitRange> rod_length;   ///< m, of all rods (of rod 1 where they differ; the others by as much)
  std::optional<FitRange> base_height;  ///< m, the base moved along z against the points
  /// The base moved by a small way in any direction; absent where the search found none.
  std::optional<Vec3> placement;
};

/// Each point against the limits (and distance from singular poses) of the options, then the three changes, each alone:
/// rods of 0.4 to 2.5 times their length and heights of up to two lengths are scanned in 400 steps, ends bisected to
/// 1e-7 m, so that a range narrower than a step may be missed; placement climbs the least margin of all points by a
/// pattern search from where the base stands and then goes back as far as the points still fit. Coordinate limits move
/// with the base and stay where rods change. Errors: WS140 (not a delta), WS142 (no points), those of field().
/// The distance of a point is searched for along 200 rays up to two reaches, the shortest of them then turned until it
/// gets no shorter. Deterministic. Cost: 5 us a point and step, some 100 ms a point.
Result<Fit> fit_points(const AnyMachine& machine, const Options& options, const std::vector<Vec3>& points);

}  // namespace polypod::workspace
