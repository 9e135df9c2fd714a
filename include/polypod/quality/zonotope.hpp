// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The image of a box under a linear map into space: { sum s_i g_i : -1 <= s_i <= 1 }, and its farthest point.
#pragma once

#include <span>
#include <vector>

#include "polypod/geometry/pose.hpp"

namespace polypod::quality {

/// The farthest point of a zonotope from its middle.
struct Farthest {
  double distance = 0;
  Vec3 point = Vec3::Zero();
  std::vector<signed char> signs;  ///< +1 or -1 of each generator; point = sum signs_i g_i
};

/// Exact: the farthest point is a vertex, and every vertex has an edge along some generator g_i. Seen along g_i the
/// others form a polygon of 2 (n - 1) vertices, walked round by angle; so all vertices of all facets along all
/// generators are visited, generators along g_i taken with its sign. Coplanar, parallel and zero generators need no
/// care: points that are visited too often are points of the zonotope all the same. Exact up to 1e-12 of the sum of
/// lengths. Cost: O(n k + k^2 log k) for k directions of the n generators: parallel ones (those of one leg) act as one.
Farthest farthest_vertex(std::span<const Vec3> generators);

/// The coordinate search of JEL 5.3, for comparison: all signs +, then each is flipped in order as long as that makes
/// the sum longer, until a whole round changes nothing. A local maximum: never above farthest_vertex.
Farthest flip_search(std::span<const Vec3> generators);

}  // namespace polypod::quality
