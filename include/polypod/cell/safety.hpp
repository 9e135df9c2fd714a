// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Distances that keep people from machines. An aid for whoever assesses the risk, not an assessment: figures follow the
// standards as they are commonly published, and are to be checked against one's own copy.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "polypod/cell/cell.hpp"
#include "polypod/cell/reach.hpp"

namespace polypod::cell {

/// ISO 13855:2010, 6.2.3: light curtain across the way of approach, detection capability d <= 40 mm, T the overall time
/// to stop (s): S = 2000 mm/s T + 8 (d - 14 mm), not below 100 mm; where that exceeds 500 mm, S = 1600 mm/s T + 8
/// (d - 14 mm), not below 500 mm. 40 mm < d <= 70 mm: S = 1600 mm/s T + 850 mm. m. No value above 70 mm.
std::optional<double> curtain_distance(double stopping, double resolution);

/// ISO 13855:2010, 6.5 and Table 1: reaching over a light curtain whose upper edge is at `curtain_height`, to a hazard
/// at `hazard_height`: S = K T + C_RO, K as above; the larger value of the neighbouring rows and the lower of the
/// columns counts. The table is that of the manual of Schmersal's SLC 420. 0: nothing is reached over it. No value for
/// upper edges below 900 mm.
std::optional<double> curtain_over_distance(double stopping, double hazard_height, double curtain_height);

/// ISO 13855:2010, 6.3: scanner with a horizontal field at the height H (m, at most 1 m): S = 1600 mm/s T + C with C =
/// 1200 mm - 0.4 H, not below 850 mm. No value where H is above 1 m or below 15 (d - 50 mm): one could crawl beneath.
std::optional<double> scanner_distance(double stopping, double height, double resolution);

/// ISO 13857:2019, Table 2 (high risk): the least horizontal distance of a hazard at `hazard_height` from a fence of
/// `fence_height`, m; the larger value of the neighbouring rows and the lower of the columns counts. 0: no distance is
/// needed. No value for fences below 1 m.
std::optional<double> reach_over_distance(double hazard_height, double fence_height);

/// The same for a hazard that reaches from the height `low` to `high`: the largest distance over all heights between,
/// which is not always that of an end, since the tables rise and fall with the height. Exact: every row of the table
/// between, and the next one at both ends.
std::optional<double> reach_over_distance(double low, double high, double fence_height);
std::optional<double> curtain_over_distance(double stopping, double low, double high, double curtain_height);

/// ISO 13857:2019, Table 4 (14 years and older): least distance of a hazard behind an opening whose smaller side (slot,
/// square) or diameter is e; m. No value above 120 mm: whole bodies pass.
std::optional<double> reach_through_distance(const std::string& shape, double e);

/// ISO 13854:2017, Table 1: gaps below which a part of the body is crushed, m.
const std::vector<std::pair<std::string, double>>& crushing_gaps();

/// The parts of the body that a gap crushes, widest first: those whose least gap is above it.
std::vector<std::string> crushed_in(double gap);

/// How long a machine needs to stand, s: as stated, or for deltas and arms their largest speed over their largest
/// deceleration, taken as large as the acceleration.
struct Stopping {
  double time = 0;
  bool stated = false;
};
Stopping stopping_of(const Machine& machine);

struct GuardFigure {
  std::string name, kind;
  double stopping = 0;  ///< s, T of ISO 13855: device, control and the slowest machine
  double needed = 0;    ///< m
  double actual = 0;    ///< m, from the guard to the place of a machine that lacks most
  bool enough = false;
  bool measured = false;  ///< it is not far enough, and the file states another measure
  std::string rule, note;
};
struct Hazard {
  std::string zone, kind, cause, measure;
  double gap = -1;                                 ///< m, below 0: none
  int severity = 0, frequency = 0, avoidance = 0;  ///< proposals for the risk graph (ISO 14121-2 style): 1 or 2
  bool sampled = false;                            ///< the gap is the least at samples: between them it may be less
};
struct Safety {
  /// m, the largest S = K T + C of a light curtain or scanner (ISO 13855), and with reaching over it: what it needs.
  /// NaN where the standard has no value for one of them.
  double guard_distance = 0, guard_needed = 0;
  double stopping = 0;  ///< s, of the slowest machine
  std::vector<GuardFigure> guards;
  std::vector<Hazard> hazards;
  std::vector<Problem> problems;  ///< guards too near, without another measure; ways past all guards
  std::vector<std::string> assumed;
  std::vector<std::string> not_judged;  ///< what the distances of guards rest on and nobody has stated
};

/// `space` are points and short segments in C that moving parts come to, with their radius (layout.hpp); they are what
/// guards keep people from. Reaching over is judged for all heights of each. Where the cell has no light curtain or
/// scanner, the guard distance is that of a curtain of 30 mm and an assumed response of 20 ms.
struct Swept {
  Vec3 at = Vec3::Zero();
  double radius = 0;
  std::string machine;
  std::optional<Vec3> to =
      std::nullopt;  ///< of a link: all points within `radius` of the segment from `at`; none: a ball
};
/// Where a person can walk to a place that a machine comes to (up to 2.7 m above the floor) and passes no guard: "from
/// the left", or "near 100, 200, 0 mm" for a gap; empty where guards surround everything. Gaps of up to about 120 mm
/// count as closed (ISO 13857, Table 4: whole bodies do not pass). Seen from above, on a grid of 30 mm, and of no more
/// than 80 mm in cells of up to 128 m.
std::string way_in(const Cell& cell, const std::vector<Swept>& space);

/// The least gap that was found between a machine, or what it carries, and something that stands.
struct Gap {
  std::string machine, what, kind;  ///< "arm", "front", "fence"
  std::string mover;                ///< "arm (empty)", "the tin in arm (empty)"
  double distance = 0;              ///< m
  Vec3 at = Vec3::Zero();           ///< m, in C, of what moves
};

/// `gaps`: those of less than the gap of a body (ISO 13854, 500 mm) are hazards, narrowest first. Gaps between belts of
/// which one feeds the other are those of their boxes.
Safety safety(const Cell& cell, const std::vector<Swept>& space, const std::vector<Gap>& gaps = {});

}  // namespace polypod::cell
