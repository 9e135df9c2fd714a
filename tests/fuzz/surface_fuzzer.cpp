// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Any bytes as an STL file and as a VTP file: refused with an error and its place, or surfaces whose corners and
// values are there, and that read back as they were written.
#include <cmath>
#include <cstdint>
#include <string_view>

#include "polypod/bodies/stl.hpp"
#include "polypod/report/vtk_reader.hpp"
#include "require.hpp"

namespace {

using namespace polypod;
using fuzz::require;

void check_stl(std::string_view bytes) {
  const auto read = bodies::triangles_of_stl(bytes, "surface.stl");
  if (!read) {
    fuzz::require_error(read.error());
    return;
  }
  const int points = static_cast<int>(read->points.size());
  for (const auto& t : read->triangles) {
    for (const int corner : t) require(corner >= 0 && corner < points, "corners are points");
    require(t[0] != t[1] && t[1] != t[2] && t[0] != t[2], "no triangle has two equal corners");
  }
  require(bodies::open_edges(read->triangles) <= 3 * read->triangles.size(), "a triangle has three edges");
  for (const Vec3& p : read->points) require(p.allFinite(), "points are numbers");
}

void check_vtp(std::string_view bytes) {
  const auto read = report::read_vtp(bytes, "surface.vtp");
  if (!read) {
    fuzz::require_error(read.error());
    return;
  }
  const auto points = static_cast<std::int64_t>(read->points.size());
  for (const auto* kind : {&read->lines, &read->polygons})
    for (const auto& cell : *kind)
      for (const std::int64_t at : cell) require(at >= 0 && at < points, "cells go over points");
  for (const report::VtkArray& array : read->arrays)
    require(array.values.size() == static_cast<std::size_t>(points * array.components), "every point has its values");
  const auto written = report::to_vtp(*read);
  require(written.has_value(), "what was read can be written");
  const auto again = report::read_vtp(*written, "again.vtp");
  require(again.has_value(), "what was written can be read");
  require(again->points.size() == read->points.size() && again->polygons == read->polygons, "and is the same");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  check_stl(bytes);
  check_vtp(bytes);
  return 0;
}
