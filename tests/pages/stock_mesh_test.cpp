// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A stock that is cut while its page plays, against the stock itself.
#include "stock_mesh.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>

namespace polypod::pages {
namespace {

constexpr double kTop = 0.010, kFloor = 0.004;  // m

TEST(GrowingCut, ASlotGrowsWithTheToolAndEndsAsTheStockDoes) {
  const auto before = cutting::Stock::block({0, 0, 0}, {0.100, 0.040, kTop}, 0.001);
  ASSERT_TRUE(before);
  cutting::Cutter cutter;
  cutter.diameter = 0.010;
  cutting::Stock after = *before;
  const Vec3 from(-0.010, 0.0205, kFloor), to(0.110, 0.0205, kFloor);
  after.cut_line(from, to, cutter.radius());
  std::vector<OnTheWay> way;
  constexpr int kPlaces = 60;
  for (int k = 0; k <= kPlaces; ++k) way.push_back({from + (to - from) * k / kPlaces, double(k), &cutter, k > 0});
  constexpr std::size_t kMost = 100000;
  const report::Mesh mesh = growing_cut(*before, after, Pose{}, 100, "stock", way, kMost);
  const report::Mesh end = stock_mesh(after, Pose{}, 100, "stock");
  ASSERT_EQ(mesh.points.size(), end.points.size());
  ASSERT_GT(mesh.shifts.at.size(), 800U);  // 100 x 9 squares at least
  EXPECT_TRUE(std::is_sorted(mesh.shifts.at.begin(), mesh.shifts.at.end()));
  std::map<int, double> last;
  for (std::size_t k = 0; k < mesh.shifts.at.size(); ++k) {
    const report::Point3& p = mesh.points[static_cast<std::size_t>(mesh.shifts.point[k])];
    last[mesh.shifts.point[k]] = mesh.shifts.by[k];
    if (std::abs(p.y - 20.5) > 4.9) continue;  // at the edge of the slot half of the layers are cut: seen at the end
    // A square is not cut before the disc is over it, and not later than its middle is.
    const double tip_mm = -10 + 120 * mesh.shifts.at[k] / kPlaces;
    EXPECT_LE(p.x - 5 - 2, tip_mm) << "at " << mesh.shifts.at[k];
    EXPECT_GE(p.x + 2, tip_mm - 2) << "at " << mesh.shifts.at[k];
    EXPECT_LE(std::abs(p.y - 20.5), 5);
  }
  for (std::size_t k = 0; k < end.points.size(); ++k) {
    const auto at = last.find(static_cast<int>(k));
    EXPECT_NEAR(mesh.points[k].z + (at == last.end() ? 0 : at->second), end.points[k].z, 1e-4) << k;
  }
}

TEST(GrowingCut, ABallLeavesARoundGrooveAndShiftsAreBounded) {
  const auto before = cutting::Stock::block({0, 0, 0}, {0.050, 0.020, kTop}, 0.001);
  ASSERT_TRUE(before);
  cutting::Cutter ball;
  ball.diameter = 0.010;
  ball.corner_radius = 0.005;
  // What the rounded cutter leaves, square by square: the lowest place of its edge over the middle.
  cutting::Stock after = *before;
  for (int i = 0; i < after.columns(); ++i) {
    for (int j = 0; j < after.rows(); ++j) {
      const double r = std::abs((j + 0.5) * 0.001 - 0.0105);
      if (r < 0.005)
        after.set_height(i, j, static_cast<float>(std::min(kTop, 0.007 + 0.005 - std::sqrt(25e-6 - r * r))));
    }
  }
  std::vector<OnTheWay> way;
  for (int k = 0; k <= 700; ++k) way.push_back({{-0.010 + 1e-4 * k, 0.0105, 0.007}, double(k), &ball, k > 0});
  const report::Mesh all = growing_cut(*before, after, Pose{}, 100, "", way, 1'000'000);
  const report::Mesh few = growing_cut(*before, after, Pose{}, 100, "", way, 1000);
  EXPECT_GT(all.shifts.at.size(), 3000U);
  EXPECT_LT(few.shifts.at.size(), 1600U) << "one a square stays";
  const auto ends = [](const report::Mesh& mesh) {
    std::map<int, double> out;
    for (std::size_t k = 0; k < mesh.shifts.at.size(); ++k) out[mesh.shifts.point[k]] = mesh.shifts.by[k];
    return out;
  };
  EXPECT_EQ(ends(all), ends(few));
  // The groove is that of a ball.
  const std::map<int, double> left = ends(all);
  for (const auto& [point, by] : left) {
    const report::Point3& p = all.points[static_cast<std::size_t>(point)];
    const double r = std::abs(p.y - 10.5);
    EXPECT_NEAR(by, 7 + 5 - std::sqrt(25 - r * r) - 10, 1e-4) << p.x << ' ' << p.y;
  }
}

TEST(GrowingCut, ThePoseTurnsTheWayDown) {
  const auto before = cutting::Stock::block({0, 0, 0}, {0.010, 0.010, kTop}, 0.001);
  ASSERT_TRUE(before);
  cutting::Stock after = *before;
  cutting::Cutter cutter;
  cutter.diameter = 0.004;
  after.cut_disc({0.005, 0.005, kFloor}, cutter.radius());
  Pose X_MW;
  X_MW.R << 0, 0, 1, 1, 0, 0, 0, 1, 0;  // z of W is x of M
  const report::Mesh mesh =
      growing_cut(*before, after, X_MW, 100, "", {{{0.005, 0.005, kFloor}, 1, &cutter, false}}, 1000);
  EXPECT_EQ(mesh.shifts.along.x, 1);
  EXPECT_EQ(mesh.shifts.along.z, 0);
  ASSERT_FALSE(mesh.shifts.by.empty());
  for (const double by : mesh.shifts.by) EXPECT_LT(by, 0);
}

}  // namespace
}  // namespace polypod::pages
