// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Triangles of STL files, closed or not.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/geometry/pose.hpp"

namespace polypod::bodies {

struct Triangles {
  std::vector<Vec3> points;  ///< in the unit of the file
  std::vector<std::array<int, 3>> triangles;
  std::size_t degenerate = 0;  ///< triangles of the file that are left out: two of their corners are equal
};
/// Of the bytes of an STL file, binary or text; equal corners are joined. Errors: BO112 (no STL file, or cut short).
/// Cost: linear.
Result<Triangles> triangles_of_stl(std::string_view bytes, const std::string& path);
/// Edges that do not have as many triangles that pass them in one direction as in the other; 0: the surface is closed.
std::size_t open_edges(const std::vector<std::array<int, 3>>& triangles);

}  // namespace polypod::bodies
