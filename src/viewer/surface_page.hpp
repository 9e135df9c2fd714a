// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a file of triangles (STL) or of polygons and lines (VTK) holds.
#pragma once

#include <string>

#include "polypod/core/error.hpp"

namespace polypod::viewer {

/// Of larger files nothing is read, bytes.
inline constexpr std::uintmax_t kLargestStl = 256U << 20U, kLargestVtp = 128U << 20U;
/// So many triangles are drawn at most.
inline constexpr std::size_t kMostTriangles = 60'000;

/// A page with the surface in space, its box, its triangles, whether it is closed, and the first scalar of its points
/// as colours. Of more than kMostTriangles the picture shows a coarser surface; the figures are of all. `path` ends in
/// .stl or .vtp. Errors: VW105 (too large), VW106 (nothing to show), FI100, BO112, RE110, RE111. Cost: some seconds and
/// three times the file in memory for the largest ones; one file at a time.
Result<std::string> surface_page(const std::string& path, const std::string& version);

}  // namespace polypod::viewer
