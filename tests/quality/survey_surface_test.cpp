// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Regions of a survey as surfaces: a shell, a ball and a box of known volume.
#include "polypod/quality/survey_surface.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <map>
#include <numbers>

#include "machines.hpp"

namespace polypod::quality {
namespace {

using test::congruent;

constexpr double kAll = std::numeric_limits<double>::infinity();

const Vec3 kCenter(0, 0, 0.01);
constexpr double kInner = 0.05, kOuter = 0.09;
double ball(double r) {
  return 4.0 / 3 * std::numbers::pi * r * r * r;
}

/// Edges that are not shared by exactly two triangles in opposite directions.
int open_edges(const workspace::Surface& s) {
  std::map<std::pair<int, int>, int> edges;
  for (const auto& t : s.triangles)
    for (std::size_t k = 0; k < 3; ++k) ++edges[{t[k], t[(k + 1) % 3]}];
  int open = 0;
  for (const auto& [edge, count] : edges) open += count != 1 || !edges.contains({edge.second, edge.first}) ? 1 : 0;
  return open;
}

struct Case {
  AnyMachine machine = congruent();
  SurveyOptions options;
  Survey survey;
  SurveyBorder border;

  explicit Case(int resolution, std::optional<std::array<Vec3, 2>> box = {}) {
    options.resolution = resolution;
    options.box = box;
    survey = *quality::survey(machine, options);
    border = *survey_border(machine, survey, options);
  }
  template <class Of>
  [[nodiscard]] std::vector<double> values(const Of& of) const {
    std::vector<double> out;
    for (const std::size_t i : survey.inside) out.push_back(of(survey.grid.at(i)));
    return out;
  }
  [[nodiscard]] workspace::Surface below(const std::vector<double>& values, double most) const {
    return *surface_below(machine, options, border, values, most);
  }
};

TEST(SurveySurface, WholeWorkspaceIsTheShell) {
  const Case c(40);
  const workspace::Surface s = c.below(std::vector<double>(c.survey.inside.size(), 0), kAll);
  EXPECT_EQ(open_edges(s), 0);
  constexpr double kChords = 0.01;  // triangles with corners on spheres enclose a little less or more
  EXPECT_NEAR(s.volume() / (ball(kOuter) - ball(kInner)), 1, kChords);
  for (const Vec3& p : s.points) {
    const double r = (p - kCenter).norm();
    const double off = std::min(std::abs(r - kInner), std::abs(r - kOuter));
    EXPECT_LT(off, 2e-3 * c.survey.grid.step[0].norm());  // points stay 1e-3 of an edge off its ends
  }
}

TEST(SurveySurface, PartOfTheShell) {
  const Case c(40);
  constexpr double kMiddle = 0.07;
  const workspace::Surface s = c.below(c.values([](const Vec3& p) { return (p - kCenter).norm(); }), kMiddle);
  EXPECT_EQ(open_edges(s), 0);
  constexpr double kChords = 0.02;
  EXPECT_NEAR(s.volume() / (ball(kMiddle) - ball(kInner)), 1, kChords);
}

TEST(SurveySurface, BoxAndHalfOfIt) {
  const Vec3 low(-0.01, -0.02, 0.07), high(0.01, 0.02, 0.08);
  const Case c(21, std::array{low, high});
  ASSERT_TRUE(c.survey.whole_box);
  const std::vector<double> x = c.values([](const Vec3& p) { return p.x(); });
  const double whole = (high - low).prod(), spacing = 0.002;
  const workspace::Surface all = c.below(x, kAll), half = c.below(x, 0.0);
  EXPECT_EQ(open_edges(all), 0);
  EXPECT_EQ(open_edges(half), 0);
  // The surface stands 1e-3 of the spacing off the box, and cuts edges and corners within a spacing.
  const double edges = 4 * (high - low).sum();
  EXPECT_NEAR(all.volume(), whole, spacing * spacing * edges / 2);
  EXPECT_NEAR(half.volume(), whole / 2, spacing * spacing * edges / 2);
  EXPECT_LT(half.volume(), 0.51 * all.volume());
  for (const Vec3& p : half.points) EXPECT_LE(p.x(), 0.002 * spacing);
}

TEST(SurveySurface, ValuesBetweenAreLinear) {
  const Case c(15, std::array{Vec3(-0.01, -0.02, 0.07), Vec3(0.01, 0.02, 0.08)});
  const auto plane = [](const Vec3& p) { return 3 + 2 * p.x() - 5 * p.y() + p.z(); };
  const std::vector<Vec3> points{{0.0013, -0.0177, 0.0741}, {-0.0099, 0.0199, 0.0799}, {0, 0, 0.075}};
  const std::vector<double> found = values_at(c.border, c.values(plane), points);
  for (std::size_t i = 0; i < points.size(); ++i) EXPECT_NEAR(found[i], plane(points[i]), 1e-12);
  EXPECT_TRUE(std::isnan(values_at(c.border, c.values([](const Vec3&) { return kAll; }), points).front()));
}

TEST(SurveySurface, NothingIsBelow) {
  const Case c(10);
  const auto s = surface_below(c.machine, c.options, c.border, std::vector<double>(c.survey.inside.size(), 2), 1);
  ASSERT_FALSE(s);
  EXPECT_EQ(s.error().id, "WS131");
}

}  // namespace
}  // namespace polypod::quality
