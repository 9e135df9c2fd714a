// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/report/vtk.hpp"

#include <fmt/format.h>

#include "packed.hpp"
#include "polypod/report/plot.hpp"

namespace polypod::report {
namespace {

/// A DataArray with its bytes inline: a header of 8 bytes with the count, then the numbers, in one piece of base64.
template <class T>
std::string data_array(const char* type, const std::string& name, int components, const std::vector<T>& values) {
  Packed packed;
  packed.add(std::uint64_t{values.size() * sizeof(T)});
  for (const T value : values) packed.add(value);
  return fmt::format(
      "<DataArray type=\"{}\" Name=\"{}\" NumberOfComponents=\"{}\" format=\"binary\">\n{}\n</DataArray>\n", type,
      escape(name), components, packed.text());
}

Result<std::string> point_data(const std::vector<VtkArray>& arrays, std::size_t points) {
  std::string out = "<PointData>\n";
  for (const VtkArray& array : arrays) {
    const std::size_t wanted = points * static_cast<std::size_t>(std::max(array.components, 0));
    if (array.components < 1 || array.values.size() != wanted) {
      return fail("RE100", fmt::format("array \"{}\" has {} numbers, but {} points of {} components need {}",
                                       array.name, array.values.size(), points, array.components, wanted));
    }
    out += data_array("Float64", array.name, array.components, array.values);
  }
  return out + "</PointData>\n";
}

std::string file(const char* type, const std::string& content) {
  return fmt::format(
      "<?xml version=\"1.0\"?>\n<VTKFile type=\"{}\" version=\"1.0\" byte_order=\"LittleEndian\" "
      "header_type=\"UInt64\">\n{}</VTKFile>\n",
      type, content);
}

/// `connectivity` and `offsets` of VTK's cell arrays.
Result<std::string> cells(const char* tag, const std::vector<std::vector<std::int64_t>>& all, std::size_t points) {
  std::vector<std::int64_t> connectivity, offsets;
  for (const auto& cell : all) {
    for (const std::int64_t index : cell) {
      if (index < 0 || index >= static_cast<std::int64_t>(points)) {
        return fail("RE102", fmt::format("a cell uses point {}, but there are {} points", index, points));
      }
      connectivity.push_back(index);
    }
    offsets.push_back(static_cast<std::int64_t>(connectivity.size()));
  }
  return fmt::format("<{0}>\n{1}{2}</{0}>\n", tag, data_array("Int64", "connectivity", 1, connectivity),
                     data_array("Int64", "offsets", 1, offsets));
}

}  // namespace

Result<std::string> to_vti(const VtkImage& image) {
  std::size_t points = 1;
  for (int i = 0; i < 3; ++i) {
    if (image.points[i] < 1 || !(image.spacing[i] > 0)) {
      return fail("RE101",
                  fmt::format("a grid of {} x {} x {} points with spacings {:g}, {:g}, {:g}", image.points[0],
                              image.points[1], image.points[2], image.spacing[0], image.spacing[1], image.spacing[2]));
    }
    points *= static_cast<std::size_t>(image.points[i]);
  }
  POLYPOD_ASSIGN(data, point_data(image.arrays, points));
  const std::string extent =
      fmt::format("0 {} 0 {} 0 {}", image.points[0] - 1, image.points[1] - 1, image.points[2] - 1);
  return file("ImageData",
              fmt::format("<ImageData WholeExtent=\"{0}\" Origin=\"{1} {2} {3}\" Spacing=\"{4} {5} {6}\">\n"
                          "<Piece Extent=\"{0}\">\n{7}</Piece>\n</ImageData>\n",
                          extent, image.origin[0], image.origin[1], image.origin[2], image.spacing[0], image.spacing[1],
                          image.spacing[2], data));
}

Result<std::string> to_vtp(const VtkPolyData& poly) {
  POLYPOD_ASSIGN(data, point_data(poly.arrays, poly.points.size()));
  POLYPOD_ASSIGN(lines, cells("Lines", poly.lines, poly.points.size()));
  POLYPOD_ASSIGN(polygons, cells("Polys", poly.polygons, poly.points.size()));
  std::vector<double> coordinates;
  coordinates.reserve(3 * poly.points.size());
  for (const auto& p : poly.points) coordinates.insert(coordinates.end(), p.begin(), p.end());
  return file("PolyData",
              fmt::format("<PolyData>\n<Piece NumberOfPoints=\"{}\" NumberOfVerts=\"0\" NumberOfLines=\"{}\" "
                          "NumberOfStrips=\"0\" NumberOfPolys=\"{}\">\n{}<Points>\n{}</Points>\n{}{}</Piece>\n"
                          "</PolyData>\n",
                          poly.points.size(), poly.lines.size(), poly.polygons.size(), data,
                          data_array("Float64", "Points", 3, coordinates), lines, polygons));
}

}  // namespace polypod::report
