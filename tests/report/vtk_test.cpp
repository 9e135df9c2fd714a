// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The bytes are taken apart again here: a decoder of base64 of its own, and the structure that VTK's XML readers ask
// for.
#include "polypod/report/vtk.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>

namespace polypod::report {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::string decoded(const std::string& text) {
  const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  unsigned bits = 0;
  int count = 0;
  for (const char c : text) {
    const std::size_t value = digits.find(c);
    if (value == std::string::npos) break;
    bits = bits << 6 | static_cast<unsigned>(value);
    count += 6;
    if (count >= 8) {
      count -= 8;
      out += static_cast<char>(bits >> count & 0xFF);
    }
  }
  return out;
}

/// The numbers of the DataArray of this name.
template <class T>
std::vector<T> array_of(const std::string& xml, const std::string& name) {
  std::size_t at = xml.find("Name=\"" + name + "\"");
  EXPECT_NE(at, std::string::npos) << name;
  if (at == std::string::npos) return {};
  at = xml.find(">\n", at) + 2;
  const std::string bytes = decoded(xml.substr(at, xml.find('\n', at) - at));
  std::uint64_t size = 0;
  EXPECT_GE(bytes.size(), sizeof size);
  std::memcpy(&size, bytes.data(), sizeof size);
  EXPECT_EQ(bytes.size(), sizeof size + size) << "the header says how many bytes follow";
  std::vector<T> values(size / sizeof(T));
  std::memcpy(values.data(), bytes.data() + sizeof size, size);
  return values;
}

TEST(Vtk, ImageHoldsItsGridAndValues) {
  VtkImage image;
  image.points = {3, 2, 1};
  image.origin = {-600, -1600, 0};
  image.spacing = {300, 150, 1};
  image.arrays = {{"C_yy_um_per_N", 1, {1, 2, 3, 4, 5, std::numeric_limits<double>::quiet_NaN()}},
                  {"a \"b\" <c>", 3, std::vector<double>(18, 0.5)}};
  const auto vti = to_vti(image);
  ASSERT_TRUE(vti);
  EXPECT_THAT(*vti, HasSubstr("<VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"LittleEndian\" "
                              "header_type=\"UInt64\">"));
  EXPECT_THAT(*vti, HasSubstr("<ImageData WholeExtent=\"0 2 0 1 0 0\" Origin=\"-600 -1600 0\" Spacing=\"300 150 1\">"));
  EXPECT_THAT(*vti, HasSubstr("<Piece Extent=\"0 2 0 1 0 0\">"));
  EXPECT_THAT(*vti, HasSubstr("Name=\"a &quot;b&quot; &lt;c&gt;\" NumberOfComponents=\"3\""));
  const auto values = array_of<double>(*vti, "C_yy_um_per_N");
  ASSERT_EQ(values.size(), 6u);
  EXPECT_THAT(std::vector<double>(values.begin(), values.begin() + 5), ElementsAre(1, 2, 3, 4, 5));
  EXPECT_TRUE(std::isnan(values[5]));
}

TEST(Vtk, Base64EndsInEveryWay) {
  // 8 bytes of header and 8 n of numbers: n = 1, 2, 3 leave 1, 0 and 2 bytes over.
  for (int n = 1; n <= 3; ++n) {
    VtkImage image;
    image.points = {n, 1, 1};
    image.arrays = {{"v", 1, std::vector<double>(static_cast<std::size_t>(n), -1.0 / 3)}};
    const auto vti = to_vti(image);
    ASSERT_TRUE(vti);
    EXPECT_EQ(array_of<double>(*vti, "v"), image.arrays[0].values) << n;
  }
}

TEST(Vtk, PolyDataHoldsItsCells) {
  VtkPolyData data;
  data.points = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
  data.lines = {{0, 1, 2}, {2, 3}};
  data.polygons = {{0, 1, 2, 3}};
  data.arrays = {{"error_um", 1, {1, 2, 3, 4}}};
  const auto vtp = to_vtp(data);
  ASSERT_TRUE(vtp);
  EXPECT_THAT(*vtp, HasSubstr("NumberOfPoints=\"4\" NumberOfVerts=\"0\" NumberOfLines=\"2\" NumberOfStrips=\"0\" "
                              "NumberOfPolys=\"1\""));
  EXPECT_THAT(array_of<double>(*vtp, "Points"), ElementsAre(0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0));
  EXPECT_THAT(array_of<std::int64_t>(*vtp, "connectivity"), ElementsAre(0, 1, 2, 2, 3));
  EXPECT_THAT(array_of<std::int64_t>(*vtp, "offsets"), ElementsAre(3, 5)) << "ends, not beginnings";
  const std::string polys = vtp->substr(vtp->find("<Polys>"));
  EXPECT_THAT(array_of<std::int64_t>(polys, "connectivity"), ElementsAre(0, 1, 2, 3));
  EXPECT_THAT(array_of<std::int64_t>(polys, "offsets"), ElementsAre(4));
}

TEST(Vtk, WrongSizesAreErrors) {
  VtkImage image;
  image.points = {2, 2, 1};
  image.arrays = {{"v", 1, {1, 2, 3}}};
  EXPECT_EQ(to_vti(image).error().id, "RE100");
  EXPECT_THAT(to_vti(image).error().message, HasSubstr("\"v\" has 3 numbers"));
  image.arrays[0].values.push_back(4);
  EXPECT_TRUE(to_vti(image));
  image.points[2] = 0;
  EXPECT_EQ(to_vti(image).error().id, "RE101");
  image.points[2] = 1;
  image.spacing[0] = 0;
  EXPECT_EQ(to_vti(image).error().id, "RE101");

  VtkPolyData data;
  data.points = {{0, 0, 0}};
  data.lines = {{0, 1}};
  EXPECT_EQ(to_vtp(data).error().id, "RE102");
  data.lines = {{-1}};
  EXPECT_EQ(to_vtp(data).error().id, "RE102");
  data.lines = {};
  data.arrays = {{"v", 0, {}}};
  EXPECT_EQ(to_vtp(data).error().id, "RE100");
}

}  // namespace
}  // namespace polypod::report
