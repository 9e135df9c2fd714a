// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The end of the cutter: closed forms, and the sum over teeth and pieces of edge as they turn.
#include "polypod/cutting/end_force.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "samples.hpp"

namespace polypod::cutting {
namespace {

using samples::between;
using samples::end_mill;
using samples::kPi;

constexpr double kRadius = 4e-3;
constexpr double kFeed = 2e-5;  // axial, per tooth
constexpr double kDown = 20e-6;
/// Of the force: 32 sectors and rays in steps of a cell, against borders that cross both.
constexpr double kResolved = 0.02;
const Eigen::Vector2d kAlongX(1, 0);

EndCoefficients coefficients() {
  return {units::from_N_per_mm2(900), units::from_N_per_mm2(150), units::from_N_per_mm2(700),
          units::from_N_per_mm(12),   units::from_N_per_mm(8),    units::from_N_per_mm(25)};
}

double tangential() {
  return coefficients().kte + coefficients().ktc * kFeed;
}
double radial() {
  return coefficients().kre + coefficients().krc * kFeed;
}
double axial() {
  return coefficients().kae + coefficients().kac * kFeed;
}

Stock block(double x_min = -10e-3) {
  auto stock = Stock::block(Vec3(x_min, -10e-3, -10e-3), Vec3(10e-3, 10e-3, 0), 0.1e-3);
  EXPECT_TRUE(stock);
  return std::move(*stock);
}

EndFootprint look(const Stock& stock, const Vec3& tip, const Eigen::Vector2d& feed = kAlongX) {
  EndFootprint footprint;
  look_down(stock, tip, kRadius, feed, kDown, footprint);
  return footprint;
}

Vec3 force(const EndFootprint& footprint) {
  return EndForce(end_mill(), coefficients()).mean_force(footprint, kFeed);
}

void expect_force(const Vec3& a, const Vec3& b, double tolerance) {
  EXPECT_LE((a - b).norm(), tolerance) << a.transpose() << " against " << b.transpose();
}

// Every tooth, every piece of its edge, every degree of a revolution; `solid(x, y)` in the frame of the cut.
Vec3 mean_by_turning(const Cutter& cutter, const std::function<bool(double, double)>& solid) {
  constexpr int kAngles = 720, kPieces = 400;
  Vec3 sum = Vec3::Zero();
  for (int i = 0; i < kAngles; ++i) {
    for (int tooth = 0; tooth < cutter.teeth; ++tooth) {
      const double phi = 2 * kPi * i / kAngles + tooth * cutter.pitch_angle(), s = std::sin(phi), c = std::cos(phi);
      for (int k = 0; k < kPieces; ++k) {
        const double dr = cutter.radius() / kPieces, r = (k + 0.5) * dr;
        if (!solid(r * s, r * c)) continue;
        sum += dr * Vec3(-tangential() * c - radial() * s, tangential() * s - radial() * c, axial());
      }
    }
  }
  return sum / kAngles;
}

TEST(EndForce, FullPlungeLeavesTheThrust) {
  const EndFootprint solid = look(block(), Vec3(0, 0, -1e-3));
  EXPECT_NEAR(solid.mean_length(), kRadius, 1e-3 * kRadius);
  const double thrust = 4 * kRadius * axial();  // 624 N
  expect_force(force(solid), Vec3(0, 0, thrust), 1e-3 * thrust);
}

TEST(EndForce, HalfDisc) {
  // Material in front of the axis alone: x from 0 on.
  const Vec3 expected = 4 * kRadius * Vec3(-radial() / kPi, tangential() / kPi, axial() / 2);
  expect_force(force(look(block(0), Vec3(0, 0, -1e-3))), expected, kResolved * expected.norm());
  // The same with the feed turned by 90 deg to the right: the material is on the left.
  const Vec3 turned(-expected.y(), expected.x(), expected.z());
  expect_force(force(look(block(0), Vec3(0, 0, -1e-3), Eigen::Vector2d(0, -1))), turned, kResolved * expected.norm());
}

TEST(EndForce, Annulus) {
  Stock stock = block();
  stock.cut_disc(Vec3(0, 0, -8e-3), 2.5e-3);  // drilled before
  const double thrust = 4 * (kRadius - 2.5e-3) * axial();
  expect_force(force(look(stock, Vec3(0, 0, -1e-3))), Vec3(0, 0, thrust), kResolved * thrust);
}

TEST(EndForce, IsTheSumOverTurningTeeth) {
  for (const double x : {-3e-3, -1e-3, 0.5e-3, 2e-3}) {  // a hole of radius 3 mm beside the axis
    Stock stock = block();
    stock.cut_disc(Vec3(x, 1.2e-3, -8e-3), 3e-3);
    const Vec3 turning =
        mean_by_turning(end_mill(), [&](double u, double v) { return std::hypot(u - x, v - 1.2e-3) > 3e-3; });
    expect_force(force(look(stock, Vec3(0, 0, -1e-3))), turning, kResolved * turning.norm());
  }
}

TEST(EndForce, CounterclockwiseIsTheMirrorImage) {
  Stock stock = block(), mirrored = block();
  stock.cut_disc(Vec3(1e-3, 2e-3, -8e-3), 3e-3);
  mirrored.cut_disc(Vec3(1e-3, -2e-3, -8e-3), 3e-3);
  const EndForce model(end_mill(), coefficients());
  const Vec3 f = model.mean_force(look(stock, Vec3(0, 0, -1e-3)), kFeed);
  const Vec3 g = model.mean_force(look(mirrored, Vec3(0, 0, -1e-3)), kFeed, Spindle::counterclockwise);
  EXPECT_GT(std::abs(f.y()), 1);
  expect_force(g, Vec3(f.x(), -f.y(), f.z()), 1e-3 * f.norm());
}

TEST(EndForce, NothingOnTheWayUpOrInTheAir) {
  const EndForce model(end_mill(), coefficients());
  const EndFootprint solid = look(block(), Vec3(0, 0, -1e-3));
  EXPECT_EQ(model.mean_force(solid, 0), Vec3::Zero());
  EXPECT_EQ(model.mean_force(solid, -kFeed), Vec3::Zero());
  EXPECT_FALSE(look(block(), Vec3(0, 0, 1e-3)).any);       // above
  EXPECT_FALSE(look(block(), Vec3(50e-3, 0, -1e-3)).any);  // beside
  EXPECT_FALSE(look(block(), Vec3(0, 0, -10e-3)).any);     // through the bottom
  Stock cut = block();
  cut.cut_disc(Vec3(0, 0, -3e-3), 1.2 * kRadius);
  EXPECT_FALSE(look(cut, Vec3(0, 0, -1e-3)).any);  // an empty hole
  EndFootprint footprint = solid;
  look_down(block(), Vec3(0, 0, -1e-3), kRadius, Eigen::Vector2d(0, 0), kDown, footprint);
  EXPECT_FALSE(footprint.any);
}

TEST(EndForce, ARampHasItsWholeDiscInMaterial) {
  for (const double slope : {0.02, 0.3, 2.0}) {
    Stock stock = block();
    const Vec3 from(-4e-3, 0, 0.05e-3), to = from + Vec3(1, 0, -slope) * std::min(6e-3, 6e-3 / slope);
    stock.cut_line(from, to, kRadius);
    ASSERT_LT(to.z(), 0);
    EXPECT_NEAR(look(stock, to).mean_length(), kRadius, 2e-3 * kRadius) << slope;
  }
}

TEST(EndForce, SideModelSlope) {
  Material m = samples::aluminium();
  const Cutter cutter = end_mill();
  const double depth = 2e-3, feed = 5e-5;
  const Vec3 side = mean_force(cutter, m, straight_engagement(cutter, CutSide::slot, 8e-3, depth), feed);
  const double slope = side_model_slope(cutter, m, depth, feed, 0.1);
  // Without coefficients the end's K_ac is taken as K_tc.
  EndFootprint disc;
  disc.any = true;
  disc.length.fill(static_cast<float>(kRadius));
  EndCoefficients like_side;
  like_side.kac = m.ktc;
  EXPECT_NEAR(EndForce(cutter, like_side).mean_force(disc, feed * std::sin(slope)).norm(), 0.1 * side.norm(),
              1e-6 * side.norm());
  EXPECT_LT(units::to_deg(slope), 5);
  m.end = coefficients();
  EXPECT_EQ(side_model_slope(cutter, m, depth, feed, 0.1), 0);  // the edge part alone is 400 N
  m.end->kae = 0;
  EXPECT_GT(side_model_slope(cutter, m, depth, feed, 0.2), side_model_slope(cutter, m, depth, feed, 0.1));
  EXPECT_EQ(side_model_slope(cutter, m, depth, feed, 1e3), kPi / 2);
}

TEST(EndCoefficients, AreReadFromTheMaterial) {
  const std::string sides =
      "Ktc_N_per_mm2 = 1000\nKrc_N_per_mm2 = 200\nKac_N_per_mm2 = 60\nKte_N_per_mm = 10\nKre_N_per_mm = 20\n"
      "Kae_N_per_mm = 2\nexponent = 0.8\n";
  const auto read = [](const std::string& text) {
    auto table = config::parse(text, "material.toml");
    EXPECT_TRUE(table);
    return material_from(*table);
  };
  const auto without = read(sides);
  ASSERT_TRUE(without);
  EXPECT_FALSE(without->end);
  const auto with = read(sides +
                         "[end]\nKtc_N_per_mm2 = 900\nKrc_N_per_mm2 = 150\nKac_N_per_mm2 = 700\nKte_N_per_mm = 12\n"
                         "Kre_N_per_mm = 8\nKae_N_per_mm = 25\n");
  ASSERT_TRUE(with) << to_string(with.error());
  ASSERT_TRUE(with->end);
  EXPECT_DOUBLE_EQ(with->end->kac, 700e6);  // whatever the exponent of the sides
  EXPECT_DOUBLE_EQ(with->end->kae, 25e3);
  EXPECT_DOUBLE_EQ(with->ktc, without->ktc);
  const auto missing = read(sides + "[end]\nKtc_N_per_mm2 = 900\n");
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().id.substr(0, 2), "CF");
  EXPECT_FALSE(read(sides + "[end]\nKtc_N_per_mm2 = -1\n"));
}

}  // namespace
}  // namespace polypod::cutting
