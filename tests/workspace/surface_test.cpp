// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Fields, sections and surfaces against closed forms, proven bounds and the machine's own verdict.
#include "polypod/workspace/surface.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <map>
#include <numbers>
#include <random>

#include "machines.hpp"

#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod::workspace {
namespace {

using test::congruent;
using test::load;

using units::from_deg;

const Vec3 kCenter(0, 0, 0.01);
constexpr double kInner = 0.05, kOuter = 0.09;

Options lengths_only(const AnyMachine& m) {
  Options options;
  options.limits &= ~*limit_bits(m, "joint");
  return options;
}

Options at_tilt(double deg) {
  Options options;
  options.directions.tilt = from_deg(deg);
  return options;
}

template <class T>
T value_of(Result<T> result) {
  EXPECT_TRUE(result) << (result ? "" : to_string(result.error()));
  return result ? std::move(*result) : T{};
}

/// How many edges are not shared by exactly two triangles in opposite directions, how many points have more than one
/// fan of triangles, and how many triangles are degenerate.
struct Flaws {
  int edges = 0, fans = 0, degenerate = 0, duplicates = 0;
  bool operator==(const Flaws&) const = default;
};
void PrintTo(const Flaws& f, std::ostream* os) {
  *os << f.edges << " bad edges, " << f.fans << " points with several fans, " << f.degenerate << " degenerate, "
      << f.duplicates << " duplicates";
}
Flaws flaws_of(const Surface& s) {
  Flaws out;
  std::map<std::pair<int, int>, int> edges;
  std::map<int, std::map<int, int>> fan;  // at a point: from the next corner to the one after
  for (const auto& t : s.triangles) {
    const Vec3 a = s.points[t[0]], b = s.points[t[1]], c = s.points[t[2]];
    if (!((b - a).cross(c - a).norm() > 0)) ++out.degenerate;
    for (std::size_t k = 0; k < 3; ++k) {
      ++edges[{t[k], t[(k + 1) % 3]}];
      fan[t[k]][t[(k + 1) % 3]] = t[(k + 2) % 3];
    }
  }
  for (const auto& [edge, count] : edges) {
    const auto back = edges.find({edge.second, edge.first});
    if (count != 1 || back == edges.end() || back->second != 1) ++out.edges;
  }
  for (const auto& [point, next] : fan) {
    std::size_t steps = 1;
    for (int at = next.begin()->second; at != next.begin()->first && steps <= next.size(); ++steps) {
      const auto it = next.find(at);
      if (it == next.end()) break;
      at = it->second;
    }
    if (steps != next.size()) ++out.fans;
  }
  std::map<std::array<double, 3>, int> seen;
  for (const Vec3& p : s.points)
    if (seen[{p.x(), p.y(), p.z()}]++ > 0) ++out.duplicates;
  return out;
}

TEST(Surface, ShellIsTwoSpheres) {
  const AnyMachine m = congruent();
  double last_error = 1;
  for (const int resolution : {24, 48}) {
    SurfaceOptions options;
    options.resolution = resolution;
    const Surface s = value_of(surface(m, lengths_only(m), options));
    const double spacing = 2 * kOuter / (resolution - 1);
    int inner = 0, outer = 0;
    for (std::size_t i = 0; i < s.points.size(); ++i) {
      const double r = (s.points[i] - kCenter).norm();
      // A root to 1e-6 of an edge, but 1e-3 of it off its ends; a space diagonal is sqrt 3 long.
      const double off = std::min(std::abs(r - kInner), std::abs(r - kOuter));
      EXPECT_LE(off, 1.1e-3 * std::sqrt(3.0) * spacing);
      const bool is_inner = std::abs(r - kInner) < std::abs(r - kOuter);
      ++(is_inner ? inner : outer);
      EXPECT_EQ(limit_kind(m, s.limit[i]),
                is_inner ? "strut below its minimum length" : "strut above its maximum length");
    }
    EXPECT_GT(inner, 100);
    EXPECT_GT(outer, 300);
    EXPECT_EQ(flaws_of(s), Flaws{});
    // Two spheres: points - edges + triangles = 4, with 3/2 edges a triangle.
    EXPECT_EQ(static_cast<int>(s.points.size()) - static_cast<int>(s.triangles.size()) / 2, 4);
    const double shell = 4.0 / 3 * std::numbers::pi * (std::pow(kOuter, 3) - std::pow(kInner, 3));
    const double error = std::abs(s.volume() - shell) / shell;
    EXPECT_LT(error, 0.4 * last_error) << "second order: a quarter at half the spacing";
    last_error = error;
  }
  EXPECT_LT(last_error, 0.003);
}

// A wall thinner than the grid comes out torn, with handles and crumbs, and closed all the same.
TEST(Surface, TornWallsAreClosed) {
  for (const char* length_min : {"80", "85", "87", "89"}) {
    SCOPED_TRACE(length_min);
    const AnyMachine m = congruent(length_min);
    SurfaceOptions options;
    options.resolution = 20;
    const Surface s = value_of(surface(m, lengths_only(m), options));
    EXPECT_GT(s.triangles.size(), 100U);
    EXPECT_EQ(flaws_of(s), Flaws{});
  }
}

TEST(Surface, ClosedAndBetweenTheBoundsForEveryMachine) {
  for (const auto& [name, tilt] : std::vector<std::pair<const char*, double>>{{"hexapod-strut", 20},
                                                                              {"hexapod-strut", 0},
                                                                              {"hexapod-slider", 15},
                                                                              {"hexapod-vertical", 5},
                                                                              {"lola50", 0}}) {
    SCOPED_TRACE(name);
    const AnyMachine m = load(name);
    const Options options = at_tilt(tilt);
    SurfaceOptions surface_options;
    surface_options.resolution = 28;
    const Surface s = value_of(surface(m, options, surface_options));
    EXPECT_EQ(flaws_of(s), Flaws{});
    Options coarse = options;
    coarse.relative_tolerance = 0.05;
    coarse.max_cells = 300'000;
    const Volume v = value_of(volume(m, coarse));
    // Where limits meet in an edge the surface cuts it off: it is a little smaller.
    EXPECT_GT(s.volume(), 0.95 * v.lower);
    EXPECT_LT(s.volume(), 1.01 * v.upper);
  }
}

TEST(Surface, RangesOfAAndB) {
  const AnyMachine m = load("lola50");
  Options options;
  options.directions.a_range = options.directions.b_range = std::array<double, 2>{from_deg(-30), from_deg(30)};
  const auto box = value_of(extent(m, options, false));
  SurfaceOptions surface_options;
  surface_options.resolution = 24;
  const Surface s = value_of(surface(m, options, surface_options));
  EXPECT_EQ(flaws_of(s), Flaws{});
  // Every point of the grid by the inverse at 5 x 5 directions. Those see more than there is: joint 5 stops at
  // 89 deg, so the tool cannot point along the forearm, and that hole of a degree falls between them.
  const Grid grid = value_of(grid_over(box.low, box.high, 24));
  FieldOptions no_tilt;
  no_tilt.tilt = false;
  const Field f = value_of(field(m, options, grid, no_tilt));
  int reached = 0, holes = 0;
  for (std::size_t i = 0; i < grid.size(); ++i) {
    bool all = true;
    for (const double a : {-30.0, -15.0, 0.0, 15.0, 30.0})
      for (const double b : {-30.0, -15.0, 0.0, 15.0, 30.0})
        all = all &&
              kinematics::inverse(m, Pose{rotation_y(from_deg(b)) * rotation_x(from_deg(a)), grid.at(i)}).reachable();
    if (f.margin[i] >= 0) {
      EXPECT_TRUE(all) << grid.at(i).transpose();
      ++reached;
    } else if (all) {
      ++holes;
      EXPECT_EQ(limit_label(m, f.limit[i]), limit_label(m, 9)) << grid.at(i).transpose();
    }
  }
  EXPECT_GT(reached, 200);
  EXPECT_GT(holes, 20);
  options.relative_tolerance = 0.2;
  const Volume proven = value_of(volume(m, options));
  EXPECT_GT(s.volume(), 0.93 * proven.lower);
  EXPECT_LT(s.volume(), 1.02 * proven.upper);
}

TEST(Surface, EmptyWorkspaceIsSaid) {
  const auto s = surface(load("hexapod-strut"), at_tilt(60));
  ASSERT_FALSE(s);
  EXPECT_EQ(s.error().id, "WS131");
  SurfaceOptions coarse;
  coarse.resolution = 7;
  EXPECT_EQ(surface(load("hexapod-strut"), at_tilt(0), coarse).error().id, "WS130");
}

TEST(Field, MarginOfTheShellIsItsDistance) {
  const AnyMachine m = congruent();
  const Grid grid = value_of(grid_over(Vec3::Constant(-0.1), Vec3::Constant(0.1), 12));
  FieldOptions options;
  options.tilt = false;
  const Field f = value_of(field(m, lengths_only(m), grid, options));
  for (std::size_t i = 0; i < grid.size(); ++i) {
    const double r = (grid.at(i) - kCenter).norm();
    EXPECT_NEAR(f.margin[i], std::min(r - kInner, kOuter - r), 1e-15);
  }
}

// What the parabolas promise: 24 directions a circle are nearly as good as 360.
TEST(Field, DirectionsBetweenTheSamplesCount) {
  for (const char* name : {"hexapod-strut", "hexapod-slider"}) {
    SCOPED_TRACE(name);
    const AnyMachine m = load(name);
    const Options options = at_tilt(20);
    const Extent box = value_of(extent(m, options, true));
    const Grid grid = value_of(grid_over(box.low, box.high, 8));
    FieldOptions few, many;
    few.tilt = many.tilt = false;
    many.azimuths = 360;
    const Field a = value_of(field(m, options, grid, few)), b = value_of(field(m, options, grid, many));
    // Inside, where no root of a slider changes: 2 um at a machine of 100 mm. Samples alone are 70 um off.
    for (std::size_t i = 0; i < grid.size(); ++i)
      if (b.margin[i] > 0) {
        EXPECT_NEAR(a.margin[i], b.margin[i], 2e-6);
      }
  }
}

// The sign of the margin is the verdict of the inverse kinematics on a dense sample of directions: where it says
// inside, all of them are; where it says outside by more than the samples may miss, some is not.
TEST(Field, MarginAgreesWithInverse) {
  std::mt19937 random(11);
  for (const char* name : {"hexapod-strut", "hexapod-slider", "lola50"}) {
    SCOPED_TRACE(name);
    const AnyMachine m = load(name);
    const double tilt = from_deg(15);
    Options options;
    options.directions.tilt = tilt;
    const Extent box = value_of(extent(m, options, true));
    const double size = (box.high - box.low).maxCoeff();
    Grid grid;
    grid.origin = box.low;
    grid.points = {7, 7, 7};
    for (int k = 0; k < 3; ++k) grid.step[k] = (box.high - box.low)[k] / 6 * Vec3::Unit(k);
    const Field f = value_of(field(m, options, grid));
    const LimitBits heeded = ~interference_bits(m);
    int inside = 0;
    for (std::size_t i = 0; i < grid.size(); ++i) {
      const auto reaches = [&](double at, double azimuth) {
        const Pose X{rotation_of(at * Vec3(-std::sin(azimuth), std::cos(azimuth), 0)), grid.at(i)};
        const auto result = kinematics::inverse(m, X);
        // Of a slider the first choice counts, of an arm any branch.
        const std::size_t count = std::string_view(name) == "lola50" ? result.solutions.size() : 1;
        for (std::size_t s = 0; s < std::min(count, result.solutions.size()); ++s)
          if ((result.solutions[s].violations & heeded) == 0) return true;
        return false;
      };
      const auto all = [&](double at, int step_deg = 5) {
        for (int k = 0; k < 360; k += step_deg)
          if (!reaches(at, from_deg(k))) return false;
        return true;
      };
      constexpr double kMissed = 1e-4;  // of the size: what a parabola between directions may be off
      if (f.margin[i] > kMissed * size) {
        ++inside;
        for (const double share : {0.0, 0.3, 0.6, 1.0}) EXPECT_TRUE(all(share * tilt)) << grid.at(i).transpose();
      }
      if (f.margin[i] < -kMissed * size) {
        bool found = !(all(0) && all(0.25 * tilt) && all(0.5 * tilt) && all(0.75 * tilt) && all(tilt));
        // An arm whose joint 5 stops just short of 90 deg cannot point along its forearm: a hole of a degree.
        for (double at = tilt; at > 0 && !found; at -= from_deg(0.4)) found = !all(at, 1);
        EXPECT_TRUE(found) << grid.at(i).transpose();
      }
      if (f.tilt[i] > 0.02) {
        EXPECT_TRUE(all(f.tilt[i] - 0.01));
        // Where the wrist of an arm is singular the tool axis has a hole of a degree: look closely.
        EXPECT_FALSE(all(f.tilt[i] + 0.002, 1) && all(f.tilt[i] + 0.005, 1) && all(f.tilt[i] + 0.01, 1));
        EXPECT_GE(f.tilt_limit[i], 0);
      }
      // Inside the cone, and only there, the largest tilt is that of the cone or more.
      if (std::abs(f.margin[i]) > kMissed * size) {
        EXPECT_EQ(f.margin[i] > 0, f.tilt[i] > tilt)
            << grid.at(i).transpose() << ": margin " << f.margin[i] << " m, limit " << f.limit[i] << ", tilt "
            << f.tilt[i] << ", limit " << f.tilt_limit[i];
      }
    }
    EXPECT_GT(inside, 3);
  }
}

TEST(Section, OfTheShellIsARing) {
  const AnyMachine m = congruent();
  // A slanted plane 20 mm from the centre.
  Plane plane;
  plane.normal = Vec3(1, 2, -2);
  plane.point = kCenter + 0.02 * plane.normal.normalized() + 0.01 * Vec3(2, -1, 0);
  FieldOptions options;
  options.tilt = false;
  const Section s = value_of(section(m, lengths_only(m), plane, 60, options));
  ASSERT_EQ(s.border.size(), 2U);
  const double outer = std::sqrt(kOuter * kOuter - 4e-4), inner = std::sqrt(kInner * kInner - 4e-4);
  const Vec3 middle = kCenter + 0.02 * plane.normal.normalized();
  for (const Loop& loop : s.border)
    for (const Vec3& p : loop) {
      const double r = (p - middle).norm();
      EXPECT_NEAR(plane.normal.normalized().dot(p - middle), 0, 1e-12);
      EXPECT_LT(std::min(std::abs(r - outer), std::abs(r - inner)), 1e-8);
    }
  EXPECT_NEAR(s.area, std::numbers::pi * (outer * outer - inner * inner), 5e-3 * s.area);
}

TEST(Section, PlanesThatMissAreErrors) {
  const AnyMachine m = congruent();
  Plane far;
  far.point = Vec3(0, 0, 5);
  EXPECT_EQ(section(m, lengths_only(m), far, 20).error().id, "WS132");
  Plane flat;
  flat.normal = Vec3::Zero();
  EXPECT_EQ(section(m, lengths_only(m), flat, 20).error().id, "WS132");
  EXPECT_EQ(section(m, lengths_only(m), Plane{}, 2).error().id, "WS130");
  FieldOptions few;
  few.azimuths = 3;
  EXPECT_EQ(section(m, lengths_only(m), Plane{}, 20, few).error().id, "WS130");
  Options wrong;
  wrong.directions.tilt = 2;
  EXPECT_EQ(section(m, wrong, Plane{}, 20).error().id, "WS100");
}

TEST(Field, SameNumbersForAnyNumberOfThreads) {
  const AnyMachine m = load("hexapod-slider");
  std::vector<Surface> surfaces;
  std::vector<Section> sections;
  for (const int threads : {1, 2, 8}) {
    Options options = at_tilt(10);
    options.threads = threads;
    SurfaceOptions surface_options;
    surface_options.resolution = 24;
    surfaces.push_back(value_of(surface(m, options, surface_options)));
    Plane plane;
    plane.point = surfaces[0].points[0];
    plane.normal = Vec3::UnitX();
    sections.push_back(value_of(section(m, options, plane, 16)));
  }
  for (std::size_t k = 1; k < 3; ++k) {
    EXPECT_EQ(surfaces[k].points, surfaces[0].points);
    EXPECT_EQ(surfaces[k].triangles, surfaces[0].triangles);
    EXPECT_EQ(surfaces[k].limit, surfaces[0].limit);
    EXPECT_EQ(sections[k].field.margin, sections[0].field.margin);
    EXPECT_EQ(sections[k].field.tilt, sections[0].field.tilt);
    EXPECT_EQ(sections[k].field.tilt_limit, sections[0].field.tilt_limit);
    EXPECT_EQ(sections[k].border, sections[0].border);
  }
}

TEST(Field, CanBeCancelled) {
  Options options = at_tilt(10);
  int asked = 0;
  options.cancelled = [&] { return ++asked > 20; };
  const auto s = surface(load("hexapod-strut"), options);
  ASSERT_FALSE(s);
  EXPECT_EQ(s.error().id, "WS110");
}

}  // namespace
}  // namespace polypod::workspace
