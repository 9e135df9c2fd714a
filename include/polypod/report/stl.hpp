// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Surfaces for printers and CAD: binary STL.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "polypod/core/error.hpp"

namespace polypod::report {

/// The bytes of a binary STL file: each triangle with its unit normal, corners counterclockwise seen from outside,
/// numbers as 32-bit floats in the unit of the points (Polypod: mm; the format has none). Two corners that are closer
/// than the floats' step become one and leave a degenerate triangle: keep points 1e-5 of the size apart. Errors: RE103
/// (an index beyond the points, or a point that is not finite).
Result<std::string> to_stl(const std::vector<std::array<double, 3>>& points,
                           const std::vector<std::array<int, 3>>& triangles);

}  // namespace polypod::report
