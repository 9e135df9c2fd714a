// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Fields and lines for ParaView: XML image data (.vti) and polygonal data (.vtp).
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "polypod/core/error.hpp"

namespace polypod::report {

/// Named values at points, `components` numbers each (1: scalar, 3: vector, 9: tensor), points slowest. NaN marks a
/// point without a value (ParaView leaves it blank).
struct VtkArray {
  std::string name;
  int components = 1;
  std::vector<double> values;
};

/// A regular grid; x fastest, then y, then z. Lengths in whatever unit the caller names in the arrays (Polypod: mm).
struct VtkImage {
  std::array<int, 3> points{1, 1, 1};
  std::array<double, 3> origin{0, 0, 0};
  std::array<double, 3> spacing{1, 1, 1};
  std::vector<VtkArray> arrays;
};

/// Points with polylines and polygons over them (indices into `points`).
struct VtkPolyData {
  std::vector<std::array<double, 3>> points;
  std::vector<std::vector<std::int64_t>> lines;
  std::vector<std::vector<std::int64_t>> polygons;
  std::vector<VtkArray> arrays;  ///< at the points
};

/// The bytes of a .vti file. Errors: RE100 (an array of the wrong length), RE101 (a grid without points or with a
/// spacing that is not positive).
Result<std::string> to_vti(const VtkImage& image);

/// The bytes of a .vtp file. Errors: RE100, RE102 (an index beyond the points).
Result<std::string> to_vtp(const VtkPolyData& data);

}  // namespace polypod::report
