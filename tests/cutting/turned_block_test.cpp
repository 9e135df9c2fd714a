// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cutting/turned_block.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "samples.hpp"

namespace polypod::cutting {
namespace {

using samples::kPi;

const Vec3 kMin(-20e-3, -15e-3, -12e-3), kMax(22e-3, 13e-3, 1e-3);
constexpr double kCell = 0.2e-3;

/// Where the line along z of S through (x, y) is in the block, by the slab method in W; empty: low > high.
struct Interval {
  double low = -std::numeric_limits<double>::infinity(), high = -low;
};
Interval line_in_block(const Mat3& R_SW, double x, double y) {
  const Vec3 o = R_SW.transpose() * Vec3(x, y, 0), d = R_SW.row(2);
  Interval out;
  for (int k = 0; k < 3; ++k) {
    if (std::abs(d[k]) < 1e-12) {
      if (o[k] < kMin[k] || o[k] > kMax[k]) return {1, -1};
      continue;
    }
    const double a = (kMin[k] - o[k]) / d[k], b = (kMax[k] - o[k]) / d[k];
    out.low = std::max(out.low, std::min(a, b));
    out.high = std::min(out.high, std::max(a, b));
  }
  return out;
}

Stock turned(const Mat3& R_SW) {
  auto stock = turned_block(kMin, kMax, R_SW, kCell);
  EXPECT_TRUE(stock) << to_string(stock.error());
  return *stock;
}

TEST(TurnedBlock, NotTurnedItIsTheBlock) {
  const Stock s = turned(Mat3::Identity());
  const Stock block = *Stock::block(kMin, kMax, kCell);
  EXPECT_TRUE(is_block(s));
  EXPECT_EQ(s.columns(), block.columns());
  EXPECT_EQ(s.rows(), block.rows());
  EXPECT_NEAR(s.x_min(), block.x_min(), 1e-15);
  EXPECT_EQ(s.layers(), block.layers());
  EXPECT_EQ(s.hollow(), nullptr);
}

// The line along the tool through the middle of a cell, by the slab method in the block's own frame.
TEST(TurnedBlock, EveryColumnIsTheIntervalOfItsLine) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> angle(-kPi, kPi);
  for (int turn = 0; turn < 8; ++turn) {
    // One by one: compilers evaluate arguments in orders of their own.
    const double about_z = angle(random), about_y = 0.5 * angle(random), about_x = angle(random);
    const Mat3 R_SW = rotation_abc(about_z, about_y, about_x);
    SCOPED_TRACE(turn);
    const Stock s = turned(R_SW);
    int inside = 0;
    for (int j = 0; j < s.rows(); ++j) {
      for (int i = 0; i < s.columns(); ++i) {
        const double x = s.x_min() + (i + 0.5) * kCell, y = s.y_min() + (j + 0.5) * kCell;
        double least = 1;  // how long the line is in the block at the cell's corners
        for (const double u : {-0.5, 0.5}) {
          for (const double v : {-0.5, 0.5}) {
            const Interval at = line_in_block(R_SW, x + u * kCell, y + v * kCell);
            least = std::min(least, at.high - at.low);
          }
        }
        if (least <= 0) {  // on the outline or beyond: the share of the cell that is inside, in eighths
          constexpr int kParts = 16;
          int parts = 0;
          for (int a = 0; a < kParts * kParts; ++a) {
            const Interval at = line_in_block(R_SW, x + ((a % kParts + 0.5) / kParts - 0.5) * kCell,
                                              y + ((a / kParts + 0.5) / kParts - 0.5) * kCell);
            parts += at.high > at.low ? 1 : 0;
          }
          const float* heights = s.cell_layers(i, j);
          int kept = 0;
          for (int k = 0; k < Stock::kLayers; ++k) kept += heights[k] > Stock::empty() ? 1 : 0;
          EXPECT_NEAR(kept / 8.0, parts / double(kParts * kParts), 1.0 / 16 + 0.03);
          continue;
        }
        ++inside;
        const Interval line = line_in_block(R_SW, x, y);
        constexpr double kFloat = 1e-8;  // heights of some hundredths of a metre in single precision
        const float* heights = s.cell_layers(i, j);
        for (int k = 0; k < Stock::kLayers; ++k) EXPECT_NEAR(heights[k], line.high, kFloat);
        const double from =
            s.hollow() == nullptr ? s.bottom() : std::max<double>(s.hollow()->cell_layers(i, j)[0], s.bottom());
        EXPECT_NEAR(from, line.low, kFloat);
      }
    }
    EXPECT_GT(inside, 1000);
    // Eighths of the cells on the outline, whose columns are short: 0.03 % in the mean over 60 turns. Where an edge
    // lies along the cells all of a row are rounded the same way: 0.13 % at worst, a third of that with cells half as
    // large.
    const double volume = (kMax - kMin).prod();
    EXPECT_NEAR(s.volume(), volume, 2e-3 * volume);
  }
}

// A flat disc that moves along x through a slab whose upper face leans by beta across the feed: over the strip at u to
// the left the material reaches depth + u tan(beta) above the disc. Mean forces by a sum over tooth angles.
TEST(TurnedBlock, WedgeAboveADiscIsTheClosedForm) {
  constexpr double kRadius = 4e-3, kDepth = 1.5e-3, kFeed = 5e-5;
  Cutter cutter = samples::end_mill();
  cutter.diameter = 2 * kRadius;
  for (const double beta_deg : {-25.0, -10.0, 5.0, 15.0, 30.0}) {
    SCOPED_TRACE(beta_deg);
    const double beta = beta_deg * kPi / 180;
    // R_WS = R_x(-beta): y of S goes down the face, so that the face rises to the left by tan(beta).
    const Mat3 R_SW = rotation_x(beta);
    Stock s = *turned_block({-30e-3, -40e-3, -40e-3}, {30e-3, 40e-3, 0}, R_SW, kCell);
    const double slope = std::tan(beta);  // of the face z_W = 0 in S over y
    const Vec3 tip(0, 0, -kDepth);
    s.cut_line(Vec3(-30e-3, 0, -kDepth), tip, kRadius);
    EngagementProfile profile;
    look_ahead(s, tip, kRadius, {1, 0}, 2 * kCell, profile);
    ASSERT_TRUE(profile.any);
    const auto depth = [&](double u) { return std::max(0.0, kDepth + slope * u); };
    for (int j = 4; j < EngagementProfile::kBins - 4; ++j) {
      const double u = kRadius * (1 - 2 * (j + 0.5) / EngagementProfile::kBins);
      EXPECT_NEAR(profile.depth[j], depth(u), 0.6 * kCell * std::abs(slope) + 1e-6) << u;
    }
    const Vec3 found = ProfileForce(cutter, samples::aluminium()).mean_force(profile, kFeed);
    Vec3 expected = Vec3::Zero();
    const Material m = samples::aluminium();
    constexpr int kSteps = 20000;
    for (int i = 0; i < kSteps; ++i) {
      const double phi = kPi * (i + 0.5) / kSteps, h = kFeed * std::sin(phi), a = depth(kRadius * std::cos(phi));
      const double t = m.kte + m.ktc * h, r = m.kre + m.krc * h, ax = m.kae + m.kac * h;
      expected += a * Vec3(-t * std::cos(phi) - r * std::sin(phi), t * std::sin(phi) - r * std::cos(phi), ax);
    }
    expected *= cutter.teeth / (2 * kPi) * kPi / kSteps;
    EXPECT_LT((found - expected).norm(), 0.01 * expected.norm());  // the cells' share, as with upright tools
  }
}

// A plate that the tool passes under on one side: what is below the plate is no material.
TEST(TurnedBlock, UndersideIsHollow) {
  constexpr double kRadius = 4e-3, kThick = 2e-3;
  const double beta = 40 * kPi / 180;
  Stock s = *turned_block({-30e-3, -30e-3, -kThick}, {30e-3, 30e-3, 0}, rotation_x(beta), kCell);
  const double slope = std::tan(beta), height = kThick / std::cos(beta);  // of the plate along the tool
  const Vec3 tip(0, 0, -1e-3);
  s.cut_line(Vec3(-40e-3, 0, tip.z()), tip, kRadius);
  EngagementProfile profile;
  look_ahead(s, tip, kRadius, {1, 0}, 2 * kCell, profile);
  for (int j = 4; j < EngagementProfile::kBins - 4; ++j) {
    const double u = kRadius * (1 - 2 * (j + 0.5) / EngagementProfile::kBins);
    const double top = slope * u, bottom = top - height;
    const double expected = std::max(0.0, top - std::max(bottom, tip.z()));
    EXPECT_NEAR(profile.depth[j], expected, 0.6 * kCell * slope + 1e-6) << u;
  }
}

TEST(TurnedBlock, BadBlocksAreRefused) {
  EXPECT_EQ(turned_block({0, 0, 0}, {0, 0, 0}, rotation_x(0.3), kCell).error().id, "CT110");
  EXPECT_EQ(turned_block(kMin, kMax, rotation_x(0.3), 1e-7).error().id, "CT111");
}

TEST(TurnedBlock, ACutBlockIsNoBlock) {
  Stock s = *Stock::block(kMin, kMax, kCell);
  EXPECT_TRUE(is_block(s));
  Stock over = s.turned(Stock::Axis::x);
  EXPECT_FALSE(is_block(over));
  s.cut_disc({0, 0, 0}, 2e-3);
  EXPECT_FALSE(is_block(s));
}

}  // namespace
}  // namespace polypod::cutting
