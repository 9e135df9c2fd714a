// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The bytes are taken apart again here: a decoder of base64 of its own, and the structure that VTK's XML readers ask
// for.
#include "polypod/report/vtk.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "polypod/report/vtk_reader.hpp"

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

/// The writer's bytes come back.
TEST(Vtk, PolyDataIsReadAsItWasWritten) {
  VtkPolyData data;
  data.points = {{0, 0, 0}, {1, 0, 0.1}, {1, 1, -1.0 / 3}, {0, 1, 1e-9}};
  data.lines = {{0, 1, 2}, {2, 3}};
  data.polygons = {{0, 1, 2, 3}, {0, 1, 2}};
  data.arrays = {{"a \"b\" <c> & d", 1, {1, std::numeric_limits<double>::quiet_NaN(), 3, 4}},
                 {"v", 3, std::vector<double>(12, 0.5)}};
  const auto read = read_vtp(*to_vtp(data), "a.vtp");
  ASSERT_TRUE(read) << to_string(read.error());
  EXPECT_EQ(read->points, data.points);
  EXPECT_EQ(read->lines, data.lines);
  EXPECT_EQ(read->polygons, data.polygons);
  ASSERT_EQ(read->arrays.size(), 2U);
  EXPECT_EQ(read->arrays[0].name, data.arrays[0].name);
  EXPECT_TRUE(std::isnan(read->arrays[0].values[1]));
  EXPECT_EQ(read->arrays[1].values, data.arrays[1].values);
}

/// A square of two triangles in each way in which VTK's writer stores numbers: as text, in base64 with the count apart,
/// appended in base64, appended raw.
TEST(Vtk, PolyDataIsReadInEachOfItsForms) {
  const auto bytes = [](const auto& values) {
    std::string out(values.size() * sizeof values[0], '\0');
    std::memcpy(out.data(), values.data(), out.size());
    const auto size = static_cast<std::uint32_t>(out.size());
    std::string head(4, '\0');
    std::memcpy(head.data(), &size, 4);
    return std::pair(head, out);
  };
  const auto base64 = [](const std::string& text) {
    const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string out;
    for (std::size_t i = 0; i < text.size(); i += 3) {
      unsigned bits = 0;
      for (std::size_t k = 0; k < 3; ++k)
        bits = bits << 8 | (i + k < text.size() ? static_cast<unsigned char>(text[i + k]) : 0U);
      for (std::size_t k = 0; k < 4; ++k) out += i + k > text.size() ? '=' : digits[bits >> (18 - 6 * k) & 63];
    }
    return out;
  };
  const std::vector<float> points{0, 0, 0, 2, 0, 0, 2, 3, 0, 0, 3, 0}, height{1, 2, 3, 4};
  const std::vector<std::int32_t> corners{0, 1, 2, 3}, ends{4};
  for (const std::string form : {"ascii", "binary", "appended", "raw"}) {
    SCOPED_TRACE(form);
    std::string appended;
    const auto array = [&](const char* type, const char* name, int components, const auto& values, const char* text) {
      const auto [head, body] = bytes(values);
      std::string content, more;
      if (form == "ascii") {
        content = text;
      } else if (form == "binary") {
        content = base64(head) + base64(body);
      } else {
        more = " offset=\"" + std::to_string(appended.size()) + "\"";
        appended += form == "raw" ? head + body : base64(head + body);
      }
      return std::string("<DataArray type=\"") + type + "\" Name=\"" + name + "\" NumberOfComponents=\"" +
             std::to_string(components) + "\" format=\"" + (form == "raw" ? "appended" : form) + "\"" + more +
             " RangeMin=\"0\">\n " + content + "\n </DataArray>\n";
    };
    std::string text =
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"PolyData\" version=\"0.1\" byte_order=\"LittleEndian\" "
        "header_type=\"UInt32\">\n<PolyData>\n"
        "<Piece NumberOfPoints=\"4\" NumberOfVerts=\"0\" NumberOfLines=\"0\" NumberOfStrips=\"0\" "
        "NumberOfPolys=\"1\">\n";
    text += "<PointData Scalars=\"height\">\n" + array("Float32", "height", 1, height, "1 2 3 4") +
            "</PointData>\n<CellData></CellData>\n";
    text += "<Points>\n" + array("Float32", "Points", 3, points, "0 0 0  2 0 0\n2 3 0  0 3 0") + "</Points>\n";
    text += "<Polys>\n" + array("Int32", "connectivity", 1, corners, "0 1 2 3") +
            array("Int32", "offsets", 1, ends, "4") + "</Polys>\n";
    text += "</Piece>\n</PolyData>\n";
    if (!appended.empty())
      text += "<AppendedData encoding=\"" + std::string(form == "raw" ? "raw" : "base64") + "\">\n_" + appended +
              "\n</AppendedData>\n";
    text += "</VTKFile>\n";
    const auto read = read_vtp(text, "a.vtp");
    ASSERT_TRUE(read) << to_string(read.error());
    ASSERT_EQ(read->points.size(), 4U);
    EXPECT_THAT(read->points[2], ElementsAre(2, 3, 0));
    ASSERT_EQ(read->polygons.size(), 1U);
    EXPECT_THAT(read->polygons[0], ElementsAre(0, 1, 2, 3));
    ASSERT_EQ(read->arrays.size(), 1U);
    EXPECT_THAT(read->arrays[0].values, ElementsAre(1, 2, 3, 4));
    // Damaged and cut files are errors or other data, never more.
    unsigned random = 1;
    for (int k = 0; k < 300; ++k) {
      std::string bad = text.substr(0, k % 2 == 0 ? text.size() : (random >> 8) % text.size());
      for (int n = 0; n < 3 && !bad.empty(); ++n) {
        random = random * 1664525U + 1013904223U;
        bad[(random >> 4) % bad.size()] = static_cast<char>(random >> 24);
      }
      const auto any = read_vtp(bad, "a.vtp");
      if (any) {
        for (const auto& p : any->polygons)
          for (const auto i : p) EXPECT_LT(static_cast<std::size_t>(i), any->points.size());
      } else {
        EXPECT_EQ(any.error().id.substr(0, 3), "RE1");
      }
    }
  }
}

TEST(Vtk, WhatIsNotReadIsNamed) {
  const auto error = [](const std::string& text) {
    const auto read = read_vtp(text, "a.vtp");
    return read ? Error{} : read.error();
  };
  EXPECT_EQ(error("").id, "RE110");
  EXPECT_EQ(error("<VTKFile type=\"ImageData\"></VTKFile>").id, "RE110");
  const Error packed = error("<VTKFile type=\"PolyData\" compressor=\"vtkZLibDataCompressor\"></VTKFile>");
  EXPECT_EQ(packed.id, "RE111");
  EXPECT_THAT(packed.hint, HasSubstr("Compressor Type None"));
  EXPECT_EQ(error("<VTKFile type=\"PolyData\" byte_order=\"BigEndian\"></VTKFile>").id, "RE111");
  const Error many =
      error("<VTKFile type=\"PolyData\"><PolyData><Piece NumberOfPoints=\"99999999999\"></Piece></PolyData></VTKFile>");
  EXPECT_EQ(many.id, "RE110");
  EXPECT_EQ(many.place.line, 1);
}

}  // namespace
}  // namespace polypod::report
