// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The bodies of a cell: what touches at rest and along the cycles, doors, floor area, and what machines sweep.
#pragma once

#include <string>
#include <vector>

#include "polypod/cell/cell.hpp"
#include "polypod/cell/reach.hpp"
#include "polypod/cell/safety.hpp"

namespace polypod::cell {

/// A box turned about z.
struct Solid {
  std::string name, kind;
  Vec3 middle = Vec3::Zero(), size = Vec3::Zero();  ///< m, in C
  double turn = 0;                                  ///< rad
  bool module = false;
  [[nodiscard]] std::vector<Vec3> corners() const;  ///< eight, the lower four first, round
};
/// Bodies, conveyors and places with a size.
std::vector<Solid> solids(const Cell& cell);

/// A round link of a machine: all points within `radius` of a segment.
struct Capsule {
  Vec3 from = Vec3::Zero(), to = Vec3::Zero();  ///< m, in C
  double radius = 0;                            ///< m
  bool tool = false;                            ///< it may touch what the machine works on
  bool mount = false;                           ///< it stands on what carries the machine
  bool cargo = false;                           ///< no link: it holds what the machine carries
};
/// The links of a machine at a pose with its joints.
std::vector<Capsule> links(const Machine& machine, const Pose& X_MT, const machine::JointVector& q);

/// What of a machine stands still: the plate of a base that has three joints or more, as a disc about them with
/// `body_diameter_mm` of edge and of thickness; rails of a base, and the column of an arm up to its second joint, as
/// round links.
struct BaseBody {
  Vec3 from = Vec3::Zero(), to = Vec3::Zero();  ///< m, in C; of a disc its axis
  double radius = 0;                            ///< m
  bool disc = false;                            ///< flat ends, else round ones
};
/// Empty where the model says nothing of its base.
std::vector<BaseBody> bases(const Machine& machine, const machine::JointVector& home);

/// Distance of a segment from a solid, m, 0 where they meet. The distance of a point from a box is convex along the
/// segment: golden section, to 1e-6 of its length.
double distance(const Vec3& from, const Vec3& to, const Solid& solid);
/// By how much two boxes reach into each other: the least way along the axes of both that parts them, m; 0 or below
/// where they are apart (separating axes; exact for boxes turned about one axis).
double overlap(const Solid& a, const Solid& b);

/// Where links of two machines come too near to each other.
struct Conflict {
  std::string first, second;  ///< "arm (empty)", "delta (fill)"
  double distance = 0;        ///< m between the surfaces; below 0: they reach into each other
  Vec3 at = Vec3::Zero();     ///< m, in C
  std::string zone;           ///< the interlock that keeps them apart; empty: none
};

struct Layout {
  std::vector<Problem> problems;    ///< collisions, doors
  std::vector<Conflict> conflicts;  ///< the nearest pair of positions of each two tasks that come too near
  std::vector<Swept> swept;         ///< where links come to, at the samples
  /// Of each machine and each body, fence and belt beside it, but where the tool works: the least gap at the samples,
  /// narrowest first.
  std::vector<Gap> gaps;
  double least_distance = 0;  ///< m, of machine and body over all samples; infinite where nothing is near
  /// m, of machine (and what it carries) and containers that stand, over all samples; infinite where nothing is near
  double least_distance_containers = 0;
  Vec3 low = Vec3::Zero(), high = Vec3::Zero();  ///< of all bodies, m
  double floor_area = 0;                         ///< m2, of the rectangle that guards and bodies take
  int positions = 0;                             ///< of machines that were judged
  bool complete = true;  ///< false: some positions were left out: too many, slots beyond 20 (40), or no way was found
};

/// Containers as upright cylinders where they can stand: in each slot of pallets, holders and openings.
struct StandingContainer {
  int spot = 0, slot = 0;
  Vec3 bottom = Vec3::Zero();  ///< m, in C
};
std::vector<StandingContainer> standing_containers(const Cell& cell);

/// Judges bodies and containers at rest, machines at home, and positions along the ways of all tasks: arms on joint
/// motions between the stands of their tasks, home, and on to the tasks that may follow; deltas on the planned cycles
/// between the corners of their window and each slot. A sample, not a proof: at most some 30 mm lie between two
/// positions of a joint motion, a 20th of its time between two of a cycle; of pairs of places with more than 20 slots
/// each, some. The tool and what it holds may touch the bodies of what it takes from and puts to while it does so.
/// Two machines are judged wherever they do not hold one zone together. What a machine carries is an exact cylinder
/// (bodies::distance) and is judged as links are. Containers are taken to stand in every slot where they ever can, but
/// where the task just takes or puts one: slots of a place to which nothing is put are emptied in their order, those
/// of a place from which nothing is taken are filled in their order. Fences are sheets. Bases (bases()) are
/// judged against bodies, fences, containers and other machines, but for the bodies that carry them: those of
/// `mounted_on`, and what the foot of an arm touches. Not judged: a machine against itself and what it carries.
Layout layout(const Cell& cell, const Motions& motions);

}  // namespace polypod::cell
