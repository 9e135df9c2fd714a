// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How many real poses six legs have, proven by dividing the space of rotations.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "leg_homotopy.hpp"

namespace polypod::machine::leg_subdivision {

using leg_homotopy::Point;

/// Six legs for the search: the same ones in the three forms that it needs. All are about the middles of the joints and
/// of size about 1.
struct Problem {
  leg_homotopy::LegsT<Interval> absolute;  ///< a_i - b_i, a_i + b_i, l_i^2 of every leg
  leg_homotopy::LegsT<Interval> proof;     ///< of legs 2 to 6 less leg 1, as the equations want them
  leg_homotopy::Legs legs;                 ///< the middles of `proof`
  bool level = false;  ///< all a_i and all b_i have z = 0 exactly: then poses come in pairs, mirrored at the plane
};

struct Options {
  int boxes = 100000;      ///< at most; then the search ends without a proof
  double smallest = 1e-7;  ///< a box no coordinate of which is wider is given up, and the proof with it: singular modes
};

/// A real zero that surely exists: exactly one lies within `radius` (as in leg_homotopy::certify).
struct RealZero {
  Point point;
  double radius = 0;
};

struct Result {
  std::vector<RealZero> zeros;  ///< surely different from each other
  bool complete = false;        ///< there is no further real zero
  bool singular = false;        ///< not complete because of a box that became too small
  int boxes = 0;                ///< that were looked at
};

/// All real zeros of the six legs, or those found and `complete` = false. `known`: points close to zeros found already,
/// which saves finding them.
///
/// Unknowns are e, g of leg_homotopy in four charts: the largest component of e is 1 and the three others lie in
/// [-1, 1], which covers every rotation; |g| <= |e| mean(l_i) follows from the mean of the legs. In a chart the
/// equations are
///   <e,g> = 0,  |g|^2 + e' H_0 e = 0 (the mean of the six legs),  2 g' D_k e + e' H_k e = 0, k = 1..5 (differences),
/// so that all but one are linear in g. In each box they are expanded about its centre, which is exact with the
/// constant second derivatives. Gauss's elimination takes g out of the six linear ones first: two equations remain that
/// hold e alone but for products of deviations; then g out of |g|^2, then e out of the three. Each row on the way is a
/// combination of the equations, with multipliers that may be any numbers: where its range over the box is without 0,
/// there is no zero in the box; else it narrows each variable. The products are bounded after they were combined.
///
/// A zero is found by Newton from a box, proven by certify, and is the only one in a box about it of sides r with
/// 2 |Y f''| (r, r) < r, Y ~ J^-1: boxes inside that are done. So the proof is complete when no box is left, and a
/// singular mode never lets it be, because no uniqueness holds there.
///
/// Rounding: all sums here have fewer than 100 terms; they are taken to err by 1e-13 of the sum of their terms' moduli,
/// bounded over the chart, which also covers the intervals of the data.
Result real_zeros(const Problem& problem, const std::vector<Point>& known, const Options& options = {});

/// A box of one chart: the component `one` of e is 1; its three others come first, then the four of g.
struct Box {
  std::array<double, leg_homotopy::kUnknowns> lo{}, hi{};
  int one = 0;
};

/// The box narrowed once round the zeros in it; empty where it is thrown away. A step of real_zeros, for tests.
std::optional<Box> narrowed(const Problem& problem, const Box& box);

/// A box with no zero but this one; empty where there is no proof of one. A step of real_zeros, for tests.
std::optional<Box> alone_in(const Problem& problem, const RealZero& zero, int one);

}  // namespace polypod::machine::leg_subdivision
