// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The workspace of any machine, with proof: which tool points are reachable from every required direction.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/kinematics/concept.hpp"
#include "polypod/machine/any_machine.hpp"

namespace polypod::workspace {

using kinematics::LimitBits;
using machine::AnyMachine;

/// The orientations in which a point must be reachable, all of them (JEL (4.1), SLAV 2.4.4).
struct Directions {
  /// Cone: every tilt up to this angle from the machine's z axis at every azimuth, rad; the tool turns by the smallest
  /// rotation that tilts it (no twist). 0 is the one orientation R = 1.
  double tilt = 0;
  /// Ranges of A and B instead of a cone, rad: R = R_y(B) R_x(A). An absent range is [0, 0] if the other is given.
  std::optional<std::array<double, 2>> a_range, b_range;

  [[nodiscard]] bool is_ranges() const { return a_range || b_range; }
};

/// What a long run reports while it works.
struct Progress {
  double lower = 0;  ///< m^3
  double upper = 0;  ///< m^3
  std::int64_t cells = 0;
  double bytes = 0;           ///< of memory for boxes and patches
  double bytes_estimate = 0;  ///< when the tolerance is met: the gap falls as the number of boxes rises
  bool sampled = false;       ///< `lower` and `upper` are of a sample, not bounds
};

struct Options {
  Directions directions;
  /// Stop when (upper - lower) <= relative_tolerance * volume. 1e-6 to 1.
  double relative_tolerance = 0.01;
  /// Leg against leg counts too (machines with a leg diameter).
  bool interference = false;
  /// Limits to check, by bit (kinematics::limit_name); a cleared bit switches a limit off. Bits of leg pairs also need
  /// `interference`.
  LimitBits limits = ~LimitBits{0};
  /// Deltas only: poses that are nearer than this to being singular by the distances of machine::Closeness (KOZ's
  /// d_min, 10 mm there) count as out of limits, m. 0: all poses count.
  double singular_distance = 0;
  /// Gives up refining beyond this many cells; `converged` is false then.
  std::int64_t max_cells = 40'000'000;
  /// Gives up refining before boxes and patches take more memory than this, bytes; `converged` is false then. A box of
  /// the boundary takes 150 bytes and 16 for each patch that matters to it. 0: no bound.
  std::size_t max_memory = 0;
  /// After the volume, the boxes at its six sides are refined until `reached` and `min`..`max` differ by no more than
  /// this share of the largest extent, or as many boxes were looked at as for the volume (at least 100 000). 0: the
  /// bounds stay as the volume leaves them, which may be loose where a large box holds next to nothing.
  double bounds_tolerance = 1e-5;
  /// Fills Volume::cells, for sections, surfaces and fields.
  bool keep_cells = false;
  int threads = 0;                                ///< 0: as many as the machine has. The result does not depend on it.
  std::function<void(const Progress&)> progress;  ///< called from the calling thread between rounds
  std::function<bool()> cancelled;                ///< asked between rounds; true ends the run with WS110
};

enum class CellState : std::uint8_t { inside, border };
/// A box of tool positions that is certainly inside, or holds a piece of the boundary.
struct Cell {
  Vec3 center = Vec3::Zero();
  Vec3 half = Vec3::Zero();
  double lower = 0;  ///< m^3 of the box that is certainly inside
  double upper = 0;  ///< m^3 beyond which the workspace cannot fill the box
  CellState state = CellState::inside;
};

/// Why a run ended before its tolerance.
enum class Stopped : std::uint8_t { no, cells, memory };

/// A box in M with a point of the workspace on each of its six sides, m.
struct Reached {
  Vec3 min = Vec3::Zero(), max = Vec3::Zero();
};

/// A workspace's volume between proven bounds, or what a sample says of it.
struct Volume {
  /// False for a machine without bounds (has_bounds): `lower` and `upper` are then the ends of the 95 % confidence
  /// interval of the sample, `min` and `max` the box that it found widened by one cell of its grid, `points` the number
  /// of points, and nothing is certain but that the points of `reached` were reached.
  bool proven = true;
  double volume = 0;        ///< m^3, the middle of the bounds
  double lower = 0;         ///< m^3
  double upper = 0;         ///< m^3
  Vec3 min = Vec3::Zero();  ///< a box in M that certainly holds the workspace, m; both 0 where it is empty
  Vec3 max = Vec3::Zero();
  /// What is certainly reached of that box; absent where no point is known to be inside. The workspace's own extents
  /// lie between the two.
  std::optional<Reached> reached;
  std::int64_t points = 0;        ///< boxes that were examined for the volume
  bool converged = true;          ///< the gap is within the tolerance
  Stopped stopped = Stopped::no;  ///< why it is not
  double memory_estimate = 0;     ///< bytes that the tolerance would take, where the run stopped before it
  bool empty = false;             ///< proven: no point is reachable from every direction
  double seconds = 0;
  std::vector<Cell> cells;
};

/// The volume of W = { p : for all R in the directions the machine keeps every limit with the tool at p in R } by
/// adaptive subdivision. A box of positions and a patch of directions are judged together: each limit is a smooth
/// function of both, bounded by its first order at the middle and a bound on the rest. Boxes that are certainly inside
/// or outside are done; in the others the boundary is enclosed between two planes per limit, so that the gap shrinks
/// with the square of the box (10^4 boundary boxes for 0.1 %). Directions need no samples: patches that keep a limit
/// over a whole box are dropped, the others are split with the box.
///
/// The extents are found by branch and bound: at each of the six sides the box that may reach farthest is split, until
/// no box can reach farther than the corners of what is certainly inside. As both come from planes, the gap falls with
/// the square of the box.
///
/// Hexapods: exact formulas per limit. Of the two roots of a slider the one nearer the outer end counts where both are
/// on the rail, direction by direction. Serial arms: the closed wrist inverse on interval derivatives; a point counts
/// where for each direction some branch keeps the limits.
///
/// Machines without bounds (arms without a spherical wrist, stages whose inverse is a search), or whose bounds would
/// take too many boxes (arms with six joints: 1.2e6 for one direction, 1.5e5 for more; legs whose coordinates follow:
/// 4e5, and 5e4 of a cone): sampled_volume(), which proves nothing. Bounds hold up to rounding (allowed for with 1e-12
/// of each limit). The same result for any number of threads. Errors: WS100 (directions out of range), WS101
/// (tolerance), WS110 (cancelled), WS104 (a delta asked to tilt), WS105 (a distance from singular poses for another
/// family). Cost: JEL Table 8.2 at 20 deg to 1 % about a second, at tilt 0 to 0.1 % a tenth of that.
Result<Volume> volume(const AnyMachine& machine, const Options& options);

/// The volume from a sample, for machines without bounds. In each cell of a cubic grid over the box that an earlier,
/// coarser grid found to be reached stand two points, each at random in the cell; the share of them that the inverse
/// reaches in all of sampled_orientations() gives the volume V = sum of cells times shares, and the differences within
/// the cells its standard error s = cell sqrt(sum (x_1 - x_2)^2) / 2. The grid becomes finer until 1.96 s is within
/// half of the relative tolerance of V with 30 cells that differ, or would have 60 000 points (`converged` is false
/// then). Where the inverse
/// is a search, a pose that it does not find counts as not reached. The same result for any number of threads. Errors:
/// those of volume(), WS106 (the task does not hold x, y, z). Cost: one inverse a point and direction.
Result<Volume> sampled_volume(const AnyMachine& machine, const Options& options);

/// Whether volume() proves its bounds for this machine.
bool has_bounds(const AnyMachine& machine);

/// The bits of a comma-separated list of groups of kinematics::limit_table. Hexapods: `length` (struts or rails),
/// `base-joint`, `platform-joint`, `joint` (both), `legs`, `base` (leg against base), `coordinates` (of the tool tip).
/// Serial arms: numbers of free joints; stages: their numbers. Error: WS103.
Result<LimitBits> limit_bits(const AnyMachine& machine, const std::string& names);

/// The limits that the options look at: those of leg pairs with `interference` alone.
LimitBits checked_limits(const AnyMachine& machine, const Options& options);

/// The bits of the limits between legs.
LimitBits interference_bits(const AnyMachine& machine);

/// Directions of the set without proof: 5 x 5 of ranges, or the axis and four circles of 12 of a cone, the widest
/// first.
std::vector<Mat3> sampled_orientations(const Directions& directions);

/// Whether the point is reached from each of these, by the inverse kinematics. Cost: one inverse each, until one fails.
bool reaches_samples(const AnyMachine& machine, const Options& options, const std::vector<Mat3>& orientations,
                     const Vec3& p);

/// A plain scan for comparison: the share of points of a regular grid of steps^3 in `min`..`max` at which a fixed
/// set of directions (4 tilts, 12 azimuths a tilt, as the source samples them) keeps the limits, times the volume. Has
/// no bounds.
double scan_volume(const AnyMachine& machine, const Options& options, const Vec3& min, const Vec3& max, int steps);

}  // namespace polypod::workspace
