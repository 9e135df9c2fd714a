// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The places of free stations with the least sum of flow times distance.
#pragma once

#include <vector>

#include "polypod/cell/planning.hpp"

namespace polypod::cell {

struct LeastWays {
  std::vector<Vec2> places;  ///< m, of all stations
  double sum = 0;            ///< flow times distance at these places
  double bound = 0;          ///< no places of the free stations give less
};

/// Minimises sum_e w_e |x_i - x_k| over the places of the stations that are not fixed: a convex problem whose minimum
/// is often not smooth, because stations come to lie on each other. Solved with sqrt(|r|^2 + eps^2) for |r| by damped
/// Newton steps while eps falls to 1e-9 of the extent of the fixed stations. What coincides is then moved onto one
/// place, where that is not worse.
///
/// The bound is that of the dual problem: for vectors y_e of at most unit length whose weighted sum vanishes at every
/// free station, sum_e w_e |r_e| >= sum_e w_e y_e . r_e, and the right side does not depend on the free places. The
/// gradients r / sqrt(|r|^2 + eps^2) are such vectors but for rounding; they are balanced by least squares and scaled
/// back to unit length, and what imbalance remains is subtracted with the radius of the fixed stations, since the free
/// ones of an optimum lie within their convex hull. Sum and bound differ by some 1e-7 of the sum. Free stations without
/// a chain of flows to a fixed one cost nothing on one place: where the mean of the present ones is.
///
/// Cost: 60 to 200 Cholesky decompositions of twice as many unknowns as free stations; 0.2 ms for eight stations.
/// Source: dual of the sum of norms as in Andersen, Christiansen, Conn and Overton, SIAM J. Sci. Comput. 22 (2000).
LeastWays least_ways(const FlowMatrix& flows, const std::vector<Station>& stations);

}  // namespace polypod::cell
