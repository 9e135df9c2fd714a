// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Where stations stand: the graphic and computing methods of layout planning (KOZ 2.1), each beside the best there is.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "polypod/cell/cell.hpp"

namespace polypod::cell {

using Vec2 = Eigen::Vector2d;
/// n x n, symmetric, zero diagonal: what two stations send each other, both ways together.
using FlowMatrix = Eigen::MatrixXd;
FlowMatrix flow_matrix(std::size_t stations, const std::vector<Flow>& flows);

/// Sum over all pairs of flow times distance. Cost: n^2 / 2, 50 ns for 8 stations.
double transport(const FlowMatrix& flows, const std::vector<Vec2>& places);

struct Plan {
  std::string method, measure;
  std::vector<Vec2> places;  ///< of each station; on a grid in steps of it, else m
  double score = 0;
  std::optional<double> best;  ///< of the best layout
  std::vector<Vec2> best_places;
  std::string best_is;          ///< what that was chosen from
  std::optional<double> bound;  ///< proven: no layout of those scores less; where the best was not enumerated
  bool larger_is_better = false;
};

/// A bound from below with six digits, rounded down.
std::string rounded_down(double bound);

/// At most this many stations are enumerated: 8! = 40320 layouts.
inline constexpr std::size_t kMostEnumerated = 8;

/// The assignment of stations to the given places with the least transport, by enumeration; places.size() is the number
/// of stations, at most kMostEnumerated. The first of equals in the order of the permutations.
std::vector<Vec2> best_assignment(const FlowMatrix& flows, const std::vector<Vec2>& places, bool fix_first = false);

/// Triangular method (Schmigalla): nodes of a grid of equal triangles with sides of 1. The two stations with the
/// largest flow begin on neighbouring nodes; then the station with the largest flow to those placed (of equals the
/// larger total flow, then the first) goes onto the free node beside a placed one with the least transport to those
/// placed (of equals the one nearest to their middle, then the first).
Plan triangular(const FlowMatrix& flows);
/// Circle method: stations on a circle in their order, neighbours 1 apart; the exchange of two that saves most, until
/// none saves. Best: enumerated with the first station held.
Plan circle(const FlowMatrix& flows);
/// Coordinate method: each station that is not fixed goes to the mean of its partners' places weighted with their
/// flows, until nothing moves. Best: the least sum of flow times distance over all places of the free stations, a
/// convex problem, with the bound of its dual; both differ by some 1e-7 of the sum. Stations may stand on each other.
/// m.
Plan coordinates(const FlowMatrix& flows, const std::vector<Station>& stations);
/// Systematic Layout Planning: the relationship chart in figures (A 4, E 3, I 2, O 1, U 0, X -1). The station with the
/// largest total stands first; then the one with the closest single relation to those placed (of equals the larger sum,
/// the larger total, the first) goes onto the cell of a square grid with the largest sum of relation times adjacency, 1
/// for a common side and 1/2 for a common corner (of equals the one nearest to the middle, then the first). Score: that
/// sum over all pairs.
Plan systematic(std::size_t stations, const std::vector<Relation>& relations);
double closeness_value(char closeness);
/// The chart from flows where none is given: A from 80 % of the largest flow, E from 60, I from 40, O from 20.
std::vector<Relation> relations_of(const FlowMatrix& flows);

struct Planning {
  std::vector<std::string> stations;
  FlowMatrix flows;
  std::vector<Relation> relations;
  bool chart_given = false, flows_given = false;
  double present = 0;  ///< sum of flow times distance as the cell stands, m an hour
  std::vector<Plan> plans;
};
/// All methods on the flows of the cell, or on `flows` where the cell gives none. No plans for more than 50 stations.
Planning planning(const Cell& cell, const std::vector<Flow>& flows);

}  // namespace polypod::cell
