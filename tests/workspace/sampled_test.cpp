// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Workspaces without proof, against closed forms; groups of limits; what lies beyond singular poses.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>

#include "machines.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/quality/survey.hpp"
#include "polypod/workspace/beyond.hpp"
#include "polypod/workspace/field.hpp"
#include "polypod/workspace/shape.hpp"
#include "polypod/workspace/task_directions.hpp"
#include "polypod/workspace/volume.hpp"

namespace polypod {
namespace {

using machine::AnyMachine;

AnyMachine read(const std::string& text) {
  const auto m = machine::from_text(text, "test.toml");
  if (!m) throw std::runtime_error(to_string(m.error()));
  return *m;
}

workspace::Volume volume(const AnyMachine& m, double tolerance) {
  workspace::Options options;
  options.relative_tolerance = tolerance;
  const auto v = workspace::volume(m, options);
  if (!v) throw std::runtime_error(to_string(v.error()));
  return *v;
}

/// An arm that turns its tool about the vertical alone has no workspace at a tilt; neither has a section a largest
/// tilt.
TEST(Sampled, ATaskWithCAloneChoosesNoTilt) {
  const AnyMachine scara = read(R"(family = "serial"
task = ["x", "y", "z", "C"]
dh = [{ a_mm = 325, d_mm = 400 }, { a_mm = 275, alpha_deg = 180 }, { joint = "prismatic" }, {}]
limits = [{ min_deg = -130, max_deg = 130 }, { min_deg = -145, max_deg = 145 }, { min_mm = 0, max_mm = 200 }, { min_deg = -360, max_deg = 360 }]
tool = { a_deg = 180 }
)");
  workspace::Options tilted;
  tilted.directions.tilt = units::from_deg(20);
  workspace::Options ranges;
  ranges.directions.a_range = {-0.1, 0.1};
  for (const workspace::Options& options : {tilted, ranges}) {
    const auto none = workspace::volume(scara, options);
    ASSERT_FALSE(none);
    EXPECT_EQ(none.error().id, "WS104");
    quality::SurveyOptions survey;
    survey.workspace = options;
    survey.box = {Vec3(0.3, -0.1, 0.25), Vec3(0.4, 0.1, 0.35)};
    EXPECT_FALSE(quality::survey(scara, survey));
  }
  EXPECT_FALSE(workspace::tilts(kinematics::task(scara)));
  EXPECT_GT(volume(scara, 0.2).lower, 0.15);
}

/// Three struts to a platform that does not turn.
const std::string kThreeStruts = R"(family = "parallel"
task = "point"
home = { z_mm = 500 }
leg = [
  { drive = "strut", base_mm = [300, 0, 0], platform_mm = [100, 0, 0], min_mm = 400, max_mm = 700 },
  { drive = "strut", base_mm = [-150, 259.8, 0], platform_mm = [-50, 86.6, 0], min_mm = 400, max_mm = 700 },
  { drive = "strut", base_mm = [-150, -259.8, 0], platform_mm = [-50, -86.6, 0], min_mm = 400, max_mm = 700 },
]
constraint = [ { kind = "orientation" } ]
)";
/// A turning joint carried by it.
AnyMachine with_a_turn(const std::string& struts) {
  return read("family = \"stages\"\ntask = [\"x\", \"y\", \"z\", \"C\"]\n[[stage]]\n[stage.machine]\n" + struts +
              R"([[stage]]
home = [0]
[stage.machine]
family = "serial"
dh = [ { d_mm = 60 } ]
limits = [ { min_deg = -180, max_deg = 180 } ]
)");
}

/// Three struts to a platform that does not turn, and one turning joint on it: the workspace of the struts, 60 mm
/// higher. Of the box that the stages could come to it takes 0.2 %, in which a few points say little of where it ends.
TEST(Sampled, ASmallWorkspaceInALargeBoxIsFoundWhole) {
  const std::string struts = kThreeStruts + "limits = { z_min_mm = 200 }\n";
  const workspace::Volume proven = volume(read(struts), 0.02);
  ASSERT_TRUE(proven.proven);
  const AnyMachine turning = with_a_turn(struts);
  const workspace::Volume v = volume(turning, 0.1);
  EXPECT_FALSE(v.proven);
  EXPECT_LE(v.lower, proven.upper);
  EXPECT_GE(v.upper, proven.lower);
  ASSERT_TRUE(v.reached && proven.reached);
  constexpr double kACell = 0.08;  // m: the corners of the workspace are sharp
  for (int k = 0; k < 3; ++k) {
    const double raised = k == 2 ? 0.06 : 0;
    EXPECT_NEAR(v.reached->min[k], proven.reached->min[k] + raised, kACell) << k;
    EXPECT_NEAR(v.reached->max[k], proven.reached->max[k] + raised, kACell) << k;
  }
}

/// Two sliders on one rail, rods of 1 m to x +- 80 mm of a platform that does not turn, 0.8 m of cross slide.
TEST(Sampled, ScissorsMeetTheirClosedForm) {
  const AnyMachine m = test::load("scissors");
  const workspace::Volume v = volume(m, 0.02);
  EXPECT_FALSE(v.proven);
  EXPECT_TRUE(v.converged);
  double area = 0;
  constexpr int kSteps = 2000;
  const auto reached = [](double to, double low, double high, double half) {
    return (to - half >= low && to - half <= high) || (to + half >= low && to + half <= high);
  };
  for (int i = 0; i < kSteps; ++i)
    for (int j = 0; j < kSteps; ++j) {
      const double x = -2.5 + 5.0 * (i + 0.5) / kSteps, z = 0.5 + 0.6 * (j + 0.5) / kSteps;
      const double height = z - 0.2, under = 1 - height * height;
      if (under < 0) continue;
      const double half = std::sqrt(under);
      if (reached(x + 0.08, -1.5, -0.1, half) && reached(x - 0.08, 0.1, 1.5, half)) area += 5.0 * 0.6;
    }
  const double truth = 0.8 * area / kSteps / kSteps;
  // 95 % of the samples hold it; this one may not move away with the threads or the order of the points.
  EXPECT_LE(v.lower, truth);
  EXPECT_GE(v.upper, truth);
  EXPECT_LT(v.upper - v.lower, 0.021 * truth);
  ASSERT_TRUE(v.reached.has_value());
  for (int k = 0; k < 3; ++k) {
    EXPECT_GE(v.reached->min[k], v.min[k]);
    EXPECT_LE(v.reached->max[k], v.max[k]);
  }
  EXPECT_GE(v.reached->min.y(), -0.4);
  EXPECT_LE(v.reached->max.y(), 0.4);
}

/// Three slides square to each other: the box of their ranges.
TEST(Sampled, ThreeSlidesReachTheirBox) {
  const AnyMachine m = read(R"(
family = "serial"
task = "point"
dh = [ { joint = "prismatic", alpha_deg = -90 }, { joint = "prismatic", theta_offset_deg = -90, alpha_deg = -90 }, { joint = "prismatic" } ]
limits = [ { min_mm = 0, max_mm = 300 }, { min_mm = 100, max_mm = 200 }, { min_mm = -50, max_mm = 150 } ]
)");
  const workspace::Volume v = volume(m, 0.05);
  EXPECT_FALSE(v.proven);
  constexpr double kTruth = 0.3 * 0.1 * 0.2;
  EXPECT_LE(v.lower, kTruth * (1 + 1e-9));
  EXPECT_GE(v.upper, kTruth * (1 - 1e-9));
  ASSERT_TRUE(v.reached.has_value());
  Vec3 seen = v.reached->max - v.reached->min;
  std::sort(seen.begin(), seen.end());
  EXPECT_NEAR(seen[0], 0.1, 0.01);
  EXPECT_NEAR(seen[1], 0.2, 0.02);
  EXPECT_NEAR(seen[2], 0.3, 0.03);
  // The same whatever the threads.
  workspace::Options one;
  one.relative_tolerance = 0.05;
  one.threads = 1;
  EXPECT_EQ(workspace::volume(m, one)->volume, v.volume);
}

TEST(Sampled, WhatNeedsAProofIsRefused) {
  const AnyMachine m = test::load("dynapod");
  EXPECT_FALSE(workspace::has_bounds(m));
  EXPECT_TRUE(workspace::has_bounds(test::load("tricept-wrist")));
  EXPECT_TRUE(workspace::has_bounds(test::load("tricept")));
  EXPECT_TRUE(workspace::has_bounds(test::load("lola50")));
  const workspace::Shape cube{workspace::ShapeKind::box, Vec3(0, 0, 0.5), Vec3::Constant(0.01)};
  EXPECT_EQ(workspace::certainly_holds(m, {}, cube).error().id, "WS102");
  workspace::Options tilted;
  tilted.directions.tilt = 0.1;
  EXPECT_EQ(workspace::volume(test::load("scissors"), tilted).error().id, "WS104");
  // Without x, y, z the three coordinates are its own: for every C the wrist is in a ring of 50 to 550 mm.
  const AnyMachine planar = read(R"(
family = "serial"
task = ["x", "y", "C"]
dh = [ { a_mm = 300 }, { a_mm = 250 }, { a_mm = 100 } ]
)");
  const workspace::Volume region = volume(planar, 0.08);
  constexpr double kPi = std::numbers::pi;
  EXPECT_FALSE(region.proven);
  EXPECT_TRUE(region.converged);
  EXPECT_NEAR(region.volume, kPi * (0.55 * 0.55 - 0.05 * 0.05) * kPi, 2 * (region.upper - region.lower));
  // Of two coordinates it is an area: the ring.
  const AnyMachine two = read("family = \"serial\"\ntask = [\"x\", \"y\"]\ndh = [ { a_mm = 300 }, { a_mm = 250 } ]\n");
  const workspace::Volume ring = volume(two, 0.08);
  EXPECT_NEAR(ring.volume, kPi * (0.55 * 0.55 - 0.05 * 0.05), 2 * (ring.upper - ring.lower));
  const AnyMachine four = read(R"(
family = "serial"
task = ["x", "y", "B", "C"]
dh = [ { a_mm = 300 }, { a_mm = 250, alpha_deg = 90 }, { a_mm = 100, alpha_deg = -90 }, { a_mm = 50 } ]
)");
  EXPECT_EQ(workspace::volume(four, {}).error().id, "WS106");
  // A point of such a task is its coordinates. Tool at the base, or 100 mm to the left of it: 600 mm reach 1 m never.
  workspace::Grid grid;
  grid.points = {3, 1, 1};
  grid.step[0] = Vec3(0.5, 0, 0);
  const auto field = workspace::field(planar, {}, grid);
  ASSERT_TRUE(field.has_value());
  EXPECT_GT(field->margin[0], 0);
  EXPECT_GT(field->margin[1], 0);
  EXPECT_LT(field->margin[2], 0);
  EXPECT_TRUE(field->tilt.empty());
  // Fields and surveys ask for the upright tool as ranges of no width.
  const auto box = workspace::extent(test::load("scissors"), {}, true);
  ASSERT_TRUE(box.has_value());
  EXPECT_FALSE(box->empty());
}

TEST(LimitGroups, EveryMachineNamesItsOwn) {
  const auto bits = [](const char* name, const char* groups) {
    return workspace::limit_bits(test::load(name), groups);
  };
  EXPECT_EQ(*bits("tricept-wrist", "2"), workspace::LimitBits{0b1111} << 12);
  EXPECT_EQ(*bits("tricept-wrist", "coordinates"), workspace::LimitBits{0b111111} << 16);
  EXPECT_EQ(*bits("tricept", "drive"), *bits("tricept", "length"));
  EXPECT_EQ(*bits("hexapod-strut", "joint"), *bits("hexapod-strut", "base-joint,platform-joint"));
  EXPECT_EQ(*bits("lola50", "2"), workspace::LimitBits{0b1100});
  const auto unknown = bits("delta-brno", "legs");
  ASSERT_FALSE(unknown);
  EXPECT_EQ(unknown.error().id, "WS103");
  EXPECT_THAT(unknown.error().hint, ::testing::HasSubstr("drive, joint, coordinates, mode, table, rods, base"));
  for (const machine::CatalogueEntry& entry : machine::catalogue()) {
    SCOPED_TRACE(entry.name);
    const AnyMachine m = test::load(std::string(entry.name));
    const machine::LimitTable table = kinematics::limit_table(m);
    ASSERT_LE(table.size(), 64U);
    for (std::size_t i = 0; i < table.size(); ++i) {
      EXPECT_FALSE(table[i].group.empty());
      EXPECT_GT(table[i].scale, 0);
      EXPECT_FALSE(kinematics::limit_name(m, static_cast<int>(i)).empty());
      const auto of_group = workspace::limit_bits(m, table[i].group);
      ASSERT_TRUE(of_group.has_value());
      EXPECT_NE(*of_group >> i & 1U, 0U);
    }
  }
}

/// Struts of 50 to 90 mm without limits of their joints carry the platform below the base as well as above.
TEST(BeyondSingular, ThePlatformBelowItsBaseIsNamed) {
  const std::string legs = R"(
family = "strut-hexapod"
base = { radius_mm = 50, pair_angle_deg = 30 }
platform = { radius_mm = 25, pair_angle_deg = 30 }
leg = { length_min_mm = 50, length_max_mm = 90 }
home = { height_mm = 65 }
)";
  const AnyMachine both = read(legs), above = read(legs + "limits = { z_min_mm = 0 }\n");
  const workspace::BeyondSingular b = workspace::beyond_singular(both, {}, volume(both, 0.05));
  EXPECT_EQ(b.points, 400U);
  EXPECT_NEAR(static_cast<double>(b.beyond), 200, 60);  // three standard deviations of a fair share
  EXPECT_EQ(workspace::beyond_singular(above, {}, volume(above, 0.05)).beyond, 0U);
  // A section across both halves, and one above.
  workspace::FieldOptions flat;
  flat.tilt = false;
  const workspace::Plane upright{Vec3::Zero(), Vec3::UnitY()};
  const auto section = workspace::section(both, {}, upright, 40, flat),
             half = workspace::section(above, {}, upright, 40, flat);
  ASSERT_TRUE(section && half);
  const workspace::BeyondSingular of_section = workspace::beyond_singular(both, {}, section->field);
  EXPECT_GT(of_section.points, 200U);
  EXPECT_EQ(2 * of_section.beyond, of_section.points);  // the grid is symmetric about z = 0
  EXPECT_EQ(workspace::beyond_singular(above, {}, half->field).beyond, 0U);
  const AnyMachine strut = test::load("hexapod-strut");
  EXPECT_EQ(workspace::beyond_singular(strut, {}, volume(strut, 0.05)).beyond, 0U);
  EXPECT_EQ(workspace::beyond_singular(test::load("lola50"), {}, volume(test::load("lola50"), 0.2)).points, 0U);
}

/// The struts reach as much below the base as above, and what they carry goes with them.
TEST(BeyondSingular, WhatAMachineCarriesGoesBelowTheBaseWithIt) {
  const AnyMachine both = with_a_turn(kThreeStruts),
                   above = with_a_turn(kThreeStruts + "limits = { z_min_mm = 200 }\n");
  const workspace::BeyondSingular b = workspace::beyond_singular(both, {}, volume(both, 0.2));
  EXPECT_EQ(b.points, 400U);
  EXPECT_NEAR(static_cast<double>(b.beyond), 200, 60);
  const workspace::BeyondSingular none = workspace::beyond_singular(above, {}, volume(above, 0.2));
  EXPECT_GT(none.points, 0U);
  EXPECT_EQ(none.beyond, 0U);
}

}  // namespace
}  // namespace polypod
