// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the machines of a cell can reach, and how long their ways take.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "polypod/cell/cell.hpp"
#include "polypod/motion/cycles.hpp"

namespace polypod::cell {

/// What is wrong with a cell: `kind` is reach, collision, door, payload, deadlock, missed, guard, ...
struct Problem {
  std::string kind, detail;
};

/// Least time over a distance d >= 0 from rest to rest with a speed of at most v and an acceleration of at most a:
/// d / v + v / a where the speed is reached (d >= v^2 / a), else 2 sqrt(d / a).
double trapezoid_time(double d, double v, double a);

/// Joint motion from rest to rest in which all joints begin and end together: the time of the slowest, by
/// trapezoid_time with its own limits.
double joint_time(const Machine& machine, const machine::JointVector& from, const machine::JointVector& to);

/// The ends of the joint motions from `from` to `to`: `to` alone, or of a machine that folds three: its joints but the
/// first to those of home; then the first turns; then the others reach out. Motions without a way are left out.
std::vector<machine::JointVector> stops(const Machine& machine, const machine::JointVector& home,
                                        const machine::JointVector& from, const machine::JointVector& to);
/// The sum of joint_time over the stops, with a rest at each.
double way_time(const Machine& machine, const machine::JointVector& home, const machine::JointVector& from,
                const machine::JointVector& to);

/// A machine at a slot of a place. Poses are X_MT.
struct Stand {
  bool ok = false;
  std::string why;         ///< where it is not
  Vec3 at = Vec3::Zero();  ///< m in C
  Pose X_above, X_at;
  machine::JointVector above, joints;  ///< rad or m; above: `clearance` higher
  double straight = 0;                 ///< s, from above down to the place
};

/// The machine at a point of C with its tool as tool_pose turns it (a heading that is not finite: away from its base),
/// and `clearance` above; the straight way between is asked for in ten steps. Near to the joints of `home`.
Stand stand_at(const Machine& m, const machine::JointVector& home, const Vec3& at, double pitch, double heading,
               double roll, double clearance);

/// Times of a machine between a belt and the slots of a place, over the part of its window where items come.
struct PickTable {
  double low = 0, high = 0, across_low = 0, across_high = 0;  ///< m, on the belt
  int columns = 0, rows = 0;                                  ///< along, across
  /// s, one table a slot and a last one for home; columns fastest. Infinite where a place is out of reach.
  std::vector<std::vector<double>> times;
  std::vector<double> home_times;  ///< s, from each slot to home; not finite for the last one
  /// Bilinear between the nodes; outside of the table its edge counts.
  [[nodiscard]] double time(std::size_t slot, double along, double across) const;
};

/// Everything that the simulation asks of the machines.
struct Motions {
  std::vector<machine::JointVector> home;               ///< of each machine
  std::vector<std::vector<std::vector<Stand>>> stands;  ///< machine, spot, slot: those that a task needs, else not ok
  std::vector<PickTable> picks;                         ///< of each task; empty where it takes no items
  std::vector<Problem> problems;                        ///< what is out of reach or too heavy
  std::vector<std::string> assumed;                     ///< times that were not planned
  int judged = 0;                                       ///< places that were asked for
  int out_of_reach = 0;                                 ///< of them
};

/// The pose of the tool in C at a point: its axis (from the flange to the work, -z_T) `pitch` below the horizontal
/// towards `heading`, y_T horizontal, then turned by `roll` about the axis.
Pose tool_pose(const Vec3& at, double pitch, double heading, double roll);

/// Range of the distance from a belt's middle over which items come to lie on it, m; empty where none come.
std::optional<std::pair<double, double>> across_range(const Cell& cell, int conveyor);

/// Asks every machine for every place of its tasks: the inverse and all limits of the machine at the place, above it
/// and on the straight way between; deltas that pick from a belt plan the whole cycle (motion::plan) between nodes of a
/// table, at most 40 mm apart along and 30 mm across, in larger windows 12 along and 12 across. Never fails: what
/// cannot be done is a problem. Cost: 1 ms a node of a delta's table, 0.1 ms a slot.
Motions motions(const Cell& cell);

/// X_MT of a machine for a point or pose in C.
inline Pose in_machine(const Machine& machine, const Pose& X_CT) {
  return machine.X_CM.inverse() * X_CT;
}
/// Whether its picks are planned cycles (motion::has_cycles), not ways between positions of joints.
bool has_cycles(const Machine& machine);
/// The limits of a delta as motion::plan takes them.
motion::MotionLimits limits_of(const Machine& machine);

}  // namespace polypod::cell
