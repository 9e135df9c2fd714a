// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// JEL 8.1: the workspaces of both hexapods against the printed tables. The source sampled a grid and a few directions;
// its volumes lie 1 to 6 % below the true ones for struts.
#include "jelenkovic.hpp"

#include <functional>

#include "polypod/workspace/volume.hpp"

namespace polypod::workspace {
namespace {

/// Printed volumes at tilt 0 and over the cone of 20 deg, mm^3.
struct Row {
  std::vector<double> keys;
  double fixed = 0, cone = 0;
};

std::vector<Row> table(const std::string& number, std::size_t keys = 1) {
  std::vector<Row> rows;
  for (const jelenkovic::Row& row : jelenkovic::table("workspace", number, keys)) {
    Row out{{}, row.printed[row.printed.size() - 2], row.printed.back()};
    for (const std::string& key : row.keys) out.keys.push_back(std::stod(key));
    rows.push_back(out);
  }
  return rows;
}

double volume_mm3(const AnyMachine& m, double tilt_deg, double tolerance) {
  Options options;
  options.directions.tilt = units::from_deg(tilt_deg);
  options.relative_tolerance = tolerance;
  const auto v = volume(m, options);
  EXPECT_TRUE(v) << to_string(v.error());
  return v ? units::to_mm3(v->volume) : 0;
}

jelenkovic::Overrides overrides_of(const std::vector<std::string>& keys, const Row& row) {
  jelenkovic::Overrides out;
  for (std::size_t i = 0; i < keys.size(); ++i) out.push_back({keys[i], std::to_string(row.keys[i])});
  return out;
}

constexpr double kTolerance = 0.01;  // half of it is the error of the middle of the bounds
constexpr double kWithin = 0.09;     // the source's own bias: its grid misses 1 to 9 %
constexpr double kTooSmall = 5000;   // mm^3: below that the source's grid holds too few points
constexpr double kZeroShare = 0.01;  // what counts as zero, of the table's largest

using Within = double (*)(const Row&);

/// Rows whose region lies at the base plane, and others that the source's own text does not fit.
using Excused = std::function<bool(const Row&)>;

void check_struts(
    const std::string& number, const std::vector<std::string>& keys, bool moved, const Excused& excused,
    Within within = [](const Row&) { return kWithin; }) {
  const std::vector<Row> rows = table(number, keys.size());
  for (const bool cone : {false, true}) {
    double best_printed = -1, best_computed = -1, largest = 0;
    std::size_t row_printed = 0, row_computed = 0;
    const auto printed = [&](const Row& r) { return cone ? r.cone : r.fixed; };
    for (const Row& r : rows) largest = std::max(largest, printed(r));
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const Row& r = rows[i];
      SCOPED_TRACE("table " + number + " row " + std::to_string(i + 1) + (cone ? " over the cone" : " at tilt 0"));
      if (excused(r)) continue;
      jelenkovic::Overrides overrides = overrides_of(keys, r);
      for (const machine::Override& o : jelenkovic::strut_home(overrides, moved)) overrides.push_back(o);
      const AnyMachine m = jelenkovic::machine_of("hexapod-strut", overrides);
      const double v = volume_mm3(m, cone ? 20 : 0, kTolerance);
      if (printed(r) > kTooSmall) {
        EXPECT_NEAR(v / printed(r), 1, within(r));
      }
      if (printed(r) == 0) {
        EXPECT_LE(v, kZeroShare * largest);
      }
      if (printed(r) > best_printed) row_printed = i;
      best_printed = std::max(best_printed, printed(r));
      if (v > best_computed) row_computed = i;
      best_computed = std::max(best_computed, v);
    }
    // Rows of equal printed volume (to the source's rounding) may change places.
    EXPECT_GE(printed(rows[row_computed]), 0.99 * printed(rows[row_printed])) << "table " << number;
  }
}

bool none(const Row&) {
  return false;
}

TEST(JelenkovicStruts, Table8_3_MinimumLength) {
  check_struts("8_3", {"leg.length_min_mm"}, false, none);
}
TEST(JelenkovicStruts, Table8_4_MaximumLength) {
  check_struts("8_4", {"leg.length_max_mm"}, true, none);
}
TEST(JelenkovicStruts, Table8_5_Tool) {
  check_struts("8_5", {"tool.length_mm"}, false, none);
}
TEST(JelenkovicStruts, Table8_6_Radii) {
  check_struts(
      "8_6", {"base.radius_mm", "platform.radius_mm"}, true,
      [](const Row& r) { return r.keys[0] == 90 || r.keys[0] == 100; },
      // r1 = 70, whose home the source does not state: 1.101 over the cone with home in the middle.
      [](const Row& r) { return r.keys[0] == 70 ? 0.11 : kWithin; });
}
TEST(JelenkovicStruts, Table8_8_Joints) {
  check_struts("8_8", {"joint.cone_deg"}, false, none);
}

void check_sliders(const std::string& number, const std::string& key, const Excused& excused_fixed,
                   const Excused& excused_cone) {
  const std::vector<Row> rows = table(number);
  struct Best {
    double printed = -1, its_computed = 0, computed = 0;
    void add(double by_source, double ours) {
      if (by_source > printed) its_computed = ours;
      printed = std::max(printed, by_source);
      computed = std::max(computed, ours);
    }
  } fixed, cone;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Row& r = rows[i];
    SCOPED_TRACE("table " + number + " row " + std::to_string(i + 1));
    const AnyMachine m = jelenkovic::machine_of("hexapod-slider", overrides_of({key}, r));
    if (!excused_fixed(r)) {
      const double v = volume_mm3(m, 0, kTolerance);
      EXPECT_NEAR(v / r.fixed, 1, kWithin) << "at tilt 0";
      fixed.add(r.fixed, v);
    }
    if (!excused_cone(r) && r.cone > 20000) {
      const double v = volume_mm3(m, 20, 0.1);
      EXPECT_NEAR(v / r.cone, 1, 0.2) << "over the cone";
      cone.add(r.cone, v);
    }
  }
  // The best row of the table is the best computed one too, or as good: 1 %, where rows of the table differ by less.
  EXPECT_GT(fixed.its_computed, 0.99 * fixed.computed) << "table " << number;
  EXPECT_GT(cone.its_computed, 0.99 * cone.computed) << "table " << number;
}

TEST(JelenkovicRails, Table8_12_Legs) {
  // Legs of 40: at 0.58 of the rail home stands so flat (49 deg from the normal) that the elevation limit cuts off
  // upright legs. The source moves home in its sweeps; at 0.62 both printed volumes come out.
  check_sliders(
      "8_12", "leg.length_mm", [](const Row& r) { return r.keys[0] == 40; }, none);
  const Row shortest = table("8_12").front();
  ASSERT_EQ(shortest.keys[0], 40);
  const auto m = machine::load("hexapod-slider", {{"leg.length_mm", "40"}, {"home.slider", "0.62"}});
  ASSERT_TRUE(m);
  EXPECT_NEAR(volume_mm3(*m, 0, kTolerance) / shortest.fixed, 1, kWithin);
  EXPECT_NEAR(volume_mm3(*m, 20, kTolerance) / shortest.cone, 1, kWithin);
}
TEST(JelenkovicRails, Table8_13_Tool) {
  check_sliders("8_13", "tool.length_mm", none, none);
}
TEST(JelenkovicRails, Table8_14_Platform) {
  check_sliders("8_14", "platform.radius_mm", none, [](const Row& r) { return r.keys[0] >= 30; });
}
TEST(JelenkovicRails, Table8_15_PairAngle) {
  check_sliders("8_15", "platform.pair_angle_deg", none, none);
}
TEST(JelenkovicRails, Table8_17_Slope) {
  const auto falling = [](const Row& r) { return r.keys[0] < 0; };
  check_sliders("8_17", "rail.inner_height_mm", falling, falling);
}
TEST(JelenkovicRails, Table8_18_Spacing) {
  const auto misprinted = [](const Row& r) { return r.keys[0] == 15; };
  check_sliders("8_18", "rail.spacing_mm", misprinted, misprinted);
}

}  // namespace
}  // namespace polypod::workspace
