// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Surfaces: what a reader of STL finds, and what hides what in a picture in space.
#include "polypod/report/scene.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <regex>

#include "polypod/report/stl.hpp"
#include "report/markup.hpp"

namespace polypod::report {
namespace {

using ::testing::AnyOf;
using ::testing::HasSubstr;
using ::testing::Not;

const std::vector<std::array<double, 3>> kCorners{{0, 0, 0}, {2, 0, 0}, {0, 3, 0}, {0, 0, 4}};
const std::vector<std::array<int, 3>> kFaces{{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};

TEST(Stl, HoldsTheTrianglesWithTheirNormals) {
  const auto bytes = to_stl(kCorners, kFaces);
  ASSERT_TRUE(bytes);
  ASSERT_EQ(bytes->size(), 84U + 4 * 50);
  EXPECT_NE(bytes->substr(0, 5), "solid") << "that would announce the text format";
  std::uint32_t count = 0;
  std::memcpy(&count, bytes->data() + 80, 4);
  EXPECT_EQ(count, 4U);
  double six = 0;
  for (std::size_t t = 0; t < 4; ++t) {
    float f[12];
    std::memcpy(f, bytes->data() + 84 + 50 * t, sizeof f);
    for (std::size_t k = 0; k < 3; ++k)
      for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(f[3 + 3 * k + i], kCorners[kFaces[t][k]][i]);
    const double n = std::sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]);
    EXPECT_NEAR(n, 1, 1e-6);
    // The normal stands on both sides of the triangle.
    for (std::size_t k = 1; k < 3; ++k) {
      double along = 0;
      for (std::size_t i = 0; i < 3; ++i) along += f[i] * (f[3 + 3 * k + i] - f[3 + i]);
      EXPECT_NEAR(along, 0, 1e-6);
    }
    six += f[3] * (f[7] * f[11] - f[8] * f[10]) + f[4] * (f[8] * f[9] - f[6] * f[11]) +
           f[5] * (f[6] * f[10] - f[7] * f[9]);
  }
  EXPECT_NEAR(six, 2 * 3 * 4, 1e-6) << "outward: the volume is positive";
}

TEST(Stl, RefusesWhatIsNoSurface) {
  EXPECT_EQ(to_stl(kCorners, {{0, 1, 4}}).error().id, "RE103");
  EXPECT_EQ(to_stl({{0, 0, 0}, {1, 0, std::numeric_limits<double>::quiet_NaN()}, {0, 1, 0}}, {{0, 1, 2}}).error().id,
            "RE103");
  EXPECT_EQ(to_stl({}, {})->size(), 84U);
}

/// A square at height z.
Mesh square(double z, int kind) {
  return {{{0, 0, z}, {1, 0, z}, {1, 1, z}, {0, 1, z}}, {{0, 1, 2}, {0, 2, 3}}, {kind, kind, kind, kind}, 1};
}

TEST(Scene, BandsAreCutWhereTheValuePassesALevel) {
  Scene scene;
  scene.elevation_deg = 90;
  scene.azimuth_deg = -90;  // x to the right, y up
  scene.kinds = {"small", "large", "absent"};
  scene.levels = {0.25, 2};
  scene.meshes = {square(0, 0)};
  scene.meshes[0].kind.clear();
  scene.meshes[0].value = {0, 1, 1, 0};  // the value is x
  const std::string svg = scene({});
  // The two triangles are cut at a quarter of the width: four pieces, in two colours.
  std::map<std::string, std::pair<double, double>> range;  // of x, by colour
  const std::regex piece("<path d=\"(M[^\"]*z)\" fill=\"(#[0-9a-f]+)\" stroke");
  int pieces = 0;
  for (std::sregex_iterator it(svg.begin(), svg.end(), piece); it != std::sregex_iterator(); ++it, ++pieces) {
    auto& [low, high] = range.try_emplace((*it)[2], 1e9, -1e9).first->second;
    for (const Point& p : corners_of((*it)[1])) {
      low = std::min(low, p.x);
      high = std::max(high, p.x);
    }
  }
  EXPECT_EQ(pieces, 4);
  ASSERT_EQ(range.size(), 2U);
  auto a = range.begin()->second, b = std::next(range.begin())->second;
  if (a.first > b.first) std::swap(a, b);
  constexpr double kPixels = 0.11;  // coordinates have one decimal
  EXPECT_NEAR(a.second, b.first, kPixels);
  EXPECT_NEAR((a.second - a.first) / (b.second - a.first), 0.25, 1e-3);
  EXPECT_NE(svg.find(">small<"), std::string::npos);
  EXPECT_EQ(svg.find(">absent<"), std::string::npos);
}

TEST(Scene, NearerIsDrawnLater) {
  Scene scene;
  scene.elevation_deg = 60;
  scene.kinds = {"lower", "upper", "absent"};
  scene.meshes = {square(1, 1), square(0, 0)};
  scene.lines = {{"pole", {{0.5, 0.5, -1}, {0.5, 0.5, -0.5}}, Colour::ink, 2, false}};
  const std::string above = scene(Canvas{});
  EXPECT_THAT(above, HasSubstr(">lower<"));
  EXPECT_THAT(above, HasSubstr(">pole<"));
  EXPECT_THAT(above, Not(HasSubstr("absent")));
  const auto first_of = [](const std::string& svg, int kind) {
    // Hue by hue: every shade of a kind is tried.
    std::size_t at = std::string::npos;
    for (int k = 0; k <= 40; ++k) {
      const std::string fill = "z\" fill=\"" + kind_colour(kind, k / 40.0) + "\"";
      at = std::min(at, svg.find(fill));
    }
    return at;
  };
  ASSERT_NE(first_of(above, 0), std::string::npos);
  EXPECT_LT(first_of(above, 0), first_of(above, 1));
  scene.elevation_deg = -60;
  const std::string below = scene(Canvas{});
  EXPECT_GT(first_of(below, 0), first_of(below, 1));
}

TEST(Scene, AClosedBodyIsDrawnFromTheSideThatIsSeen) {
  // A cube of two triangles a face: three faces are seen from anywhere in general.
  Mesh cube;
  for (int k = 0; k < 8; ++k) cube.points.push_back({double(k & 1), double(k >> 1 & 1), double(k >> 2 & 1)});
  cube.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                    {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  Scene scene;
  scene.kinds = {"body"};
  scene.meshes = {cube};
  const auto faces = [](const Scene& s) { return count_of(s(Canvas{}), "z\" fill=\"#"); };
  EXPECT_EQ(faces(scene), 6);
  scene.meshes[0].opacity = 0.5;
  EXPECT_EQ(faces(scene), 12) << "what lets light through shows its far side";
  scene.meshes[0].opacity = 1;
  scene.meshes[0].triangles.pop_back();
  EXPECT_EQ(faces(scene), 11) << "an open one shows its inner side";
}

TEST(Scene, BearsAnything) {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  Scene scene;
  EXPECT_THAT(scene(Canvas{}), HasSubstr("<svg"));
  scene.meshes = {{{{0, 0, 0}, {1, 0, kNaN}, {1, 1, 1}}, {{0, 1, 2}, {0, 2, 7}, {0, -1, 2}}, {}, 1}};
  scene.lines = {{"a & b", {{kNaN, 0, 0}, {1, 1, 1}}, Colour::blue, 1, true}};
  for (const double elevation : {-90.0, 0.0, 90.0}) {
    scene.elevation_deg = elevation;
    const std::string svg = scene(Canvas{300, "q"});
    EXPECT_THAT(svg, HasSubstr("a &amp; b"));
    EXPECT_THAT(svg, Not(HasSubstr("nan")));
    EXPECT_THAT(svg, Not(HasSubstr("inf")));
  }
}

// The encodings are checked against strings made with Python's struct and base64:
// base64.b64encode(struct.pack('<3f', 0, 1, float('nan'))) and so on.
TEST(SceneData, HoldsPointsInStepsAndLinesAsFloats) {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  Scene scene;
  scene.kinds = {"a", "b"};
  scene.meshes = {
      {{{0, 0, 0}, {94, 0, 0}, {0, 94, 94}, {kNaN, 0, 0}}, {{0, 1, 2}, {0, 1, 3}, {0, 1, 9}}, {0, 1, -1, 0}, 0.5}};
  scene.lines = {{"way", {{0, 1, kNaN}}, Colour::sky, 2, true}};
  const std::string json = scene_data(scene);
  // The box has 3 % air on each side: -2.82 .. 96.82, so 0 is step 1854.54 and 94 step 63679.46 of 65534.
  EXPECT_THAT(json, HasSubstr("\"low\":[-2.82,-2.82,-2.82]"));
  EXPECT_THAT(json, HasSubstr("\"data\":\"Pwc/Bz8Hv/g/Bz8HPwe/+L/4//8/Bz8H\"")) << json;
  EXPECT_THAT(json, HasSubstr("\"triangles\":\"AAAAAAEAAAACAAAA\"")) << "those with a point that is there";
  EXPECT_THAT(json, HasSubstr("\"kind\":\"AAH/AA==\""));
  EXPECT_THAT(json, HasSubstr("\"points\":\"AAAAAAAAgD8AAMB/\""));
  EXPECT_THAT(json, HasSubstr("\"colour\":\"sky\""));
  EXPECT_THAT(json, Not(HasSubstr("nan")));
}

/// Numbers in steps as a reader has them; `step` is that of each of the numbers.
struct Read {
  std::vector<double> values, step;
};
Read read_steps(const nlohmann::json& steps) {
  const auto whole = numbers_of<std::uint16_t>(bytes_of(steps["data"]));
  const auto low = steps["low"].get<std::vector<double>>(), step = steps["step"].get<std::vector<double>>();
  Read out;
  for (std::size_t i = 0; i < whole.size(); ++i) {
    const std::size_t k = i % low.size();
    out.values.push_back(whole[i] == 65535 ? std::nan("") : low[k] + step[k] * whole[i]);
    out.step.push_back(step[k]);
  }
  return out;
}
void expect_read(const Read& read, const std::vector<double>& given, double range, const char* what) {
  ASSERT_EQ(read.values.size(), given.size()) << what;
  constexpr double kRounding = 1 + 1e-9;  // of the sums, of half a step
  for (std::size_t i = 0; i < given.size(); ++i) {
    if (!std::isfinite(given[i])) {
      EXPECT_TRUE(std::isnan(read.values[i])) << what << " " << i;
      continue;
    }
    EXPECT_NEAR(read.values[i], given[i], read.step[i] / 2 * kRounding) << what << " " << i;
    EXPECT_LT(read.step[i], range / 60000) << "a step is small beside what there is";
  }
}
std::vector<double> coordinates(const std::vector<Point3>& points) {
  std::vector<double> out;
  for (const Point3& p : points) out.insert(out.end(), {p.x, p.y, p.z});
  return out;
}

TEST(SceneData, WhatIsPutInIsReadBack) {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  Scene scene;
  Mesh mesh;
  mesh.points = {{-300, 20, 1000}, {17.3, 21.7, 1033.3}, {412.9, 27, 1077}, {55, 23.1, 1050.5}};
  mesh.triangles = {{0, 1, 2}, {1, 2, 3}};
  mesh.value = {-7.25, 0.4, 93.111, kNaN};
  mesh.shifts.along = {0.6, 0, -0.8};
  mesh.shifts.at = {0.1, 2.5, 2.75};
  mesh.shifts.point = {2, 0, 2};
  mesh.shifts.by = {-1.3, 4.7, 12.9};
  scene.meshes = {mesh};
  scene.levels = {1, 10};
  scene.lines = {{"tool", {{-290, 20, 1001}, {400, 26, 1070}}}};
  scene.lines[0].moves = true;
  Frames frames;
  frames.at = {0, 1};
  frames.points = {scene.lines[0].points, {{-250.5, 22.2, 1040}, {333.3, 25.1, 1012}}};
  scene.frames = {frames};

  const nlohmann::json json = nlohmann::json::parse(scene_data(scene));
  const nlohmann::json& read = json["meshes"][0];
  constexpr double kWidest = 2 * 712.9;  // mm, of the scene with its air
  expect_read(read_steps(read["points"]), coordinates(mesh.points), kWidest, "point");
  expect_read(read_steps(read["value"]), mesh.value, 93.111 + 7.25 + 1, "value");
  std::vector<double> moving;
  for (const auto& frame : frames.points)
    for (const double x : coordinates(frame)) moving.push_back(x);
  expect_read(read_steps(json["frames"][0]["points"]), moving, kWidest, "point of a frame");

  const nlohmann::json& shifts = read["shifts"];
  EXPECT_EQ(shifts["along"].get<std::vector<double>>(), (std::vector<double>{0.6, 0, -0.8}));
  const auto floats = [&](const char* key) { return numbers_of<float>(bytes_of(shifts[key])); };
  EXPECT_EQ(floats("at"), (std::vector<float>{0.1F, 2.5F, 2.75F}));
  EXPECT_EQ(numbers_of<std::uint32_t>(bytes_of(shifts["point"])), (std::vector<std::uint32_t>{2, 0, 2}));
  EXPECT_EQ(floats("by"), (std::vector<float>{-1.3F, 4.7F, 12.9F}));
}

TEST(SceneData, FramesWidenTheBoxAndKeepTheirOrder) {
  Scene scene;
  scene.lines = {{"still", {{0, 0, 0}, {1, 0, 0}}}, {"moves", {{0, 0, 0}}}};
  scene.lines[1].moves = true;
  Frames frames;
  frames.at = {0, 0.5};
  frames.points = {{{0, 0, 0}}, {{0, 0, 10}}};
  frames.columns = {{"q", "mm", {1.5, std::numeric_limits<double>::quiet_NaN()}}};
  frames.notes = {"", "too <far>"};
  scene.frames = {frames};
  const std::string json = scene_data(scene);
  EXPECT_GT(box_of(scene, true).high.z, 10);
  EXPECT_LT(box_of(scene, false).high.z, 1) << "the drawing shows the first frame alone";
  EXPECT_THAT(json, HasSubstr("\"at\":[0,0.5]"));
  EXPECT_THAT(json, HasSubstr("\"values\":[1.5,null]"));
  EXPECT_THAT(json, HasSubstr("[\"\",\"too \\u003cfar\\u003e\"]"));
}

TEST(HeatMap, KindsColourAndBlankIsBlank) {
  HeatMap map;
  map.columns = 3;
  map.rows = 2;
  map.values = {-5, 1, 2, -5, 1, 2};
  map.kind = {-1, 0, 1, -1, 0, 1};
  map.kinds = {"first", "second", "absent"};
  map.min = 0;
  map.blank_below = true;
  const std::string svg = map(Canvas{});
  EXPECT_THAT(svg, HasSubstr(">first<"));
  EXPECT_THAT(svg, HasSubstr(">second<"));
  EXPECT_THAT(svg, Not(HasSubstr("absent")));
  HeatMap empty = map;
  empty.values.assign(6, -1);
  const std::string blank = empty(Canvas{});
  EXPECT_THAT(blank, Not(HasSubstr(">first<")));
  EXPECT_THAT(blank, Not(AnyOf(HasSubstr("Z\" fill=\"#"), HasSubstr("z\" fill=\"#")))) << "nothing is filled";
}

}  // namespace
}  // namespace polypod::report
