// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cutting/stock.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "polypod/cutting/end_force.hpp"
#include "samples.hpp"

namespace polypod::cutting {
namespace {

using samples::aluminium;
using samples::between;
using samples::end_mill;
using samples::kPi;
using Vec2 = Eigen::Vector2d;

constexpr double kRadius = 4e-3;
constexpr double kCell = 0.025 * 2 * kRadius;
constexpr double kAp = 2e-3;
constexpr double kFeed = 5e-5;
// Heights are floats: 0.01 m is kept to 1e-9 m, and the level of a cell comes from a few such roundings.
constexpr double kHeightRounding = 4e-9;
// Removed volumes are summed in floats row by row.
constexpr double kSumRounding = 1e-5;

Stock plate(double half = 15e-3, double bottom = -5e-3, double cell = kCell) {
  auto stock = Stock::block({-half, -half, bottom}, {half, half, 0}, cell);
  EXPECT_TRUE(stock) << to_string(stock.error());
  return *stock;
}

Vec3 at(const Vec2& p, double z) {
  return {p.x(), p.y(), z};
}
Vec2 direction(double angle) {
  return {std::cos(angle), std::sin(angle)};
}
Vec2 left_of(const Vec2& f) {
  return {-f.y(), f.x()};
}

double largest_difference(const Stock& a, const Stock& b) {
  double most = 0;
  for (std::size_t i = 0; i < a.layers().size(); ++i) {
    const double p = std::max<double>(a.layers()[i], a.bottom()), q = std::max<double>(b.layers()[i], b.bottom());
    most = std::max(most, std::abs(p - q));
  }
  return most;
}

TEST(Block, GridAndVolume) {
  const Stock s = *Stock::block({0, 0, -3e-3}, {20e-3, 10e-3, 1e-3}, 1e-3);
  EXPECT_EQ(s.columns(), 20);
  EXPECT_EQ(s.rows(), 10);
  EXPECT_NEAR(s.volume(), 20e-3 * 10e-3 * 4e-3, 1e-13);
  EXPECT_EQ(s.height(19, 9), 1e-3f);
  EXPECT_EQ(s.top(), 1e-3f);
}

TEST(Block, CellsThatDoNotFitAreCentred) {
  const Stock s = *Stock::block({0, 0, -1e-3}, {10.4e-3, 9.6e-3, 0}, 1e-3);
  EXPECT_EQ(s.columns(), 10);
  EXPECT_EQ(s.rows(), 10);
  EXPECT_NEAR(s.x_min(), 0.2e-3, 1e-15);
  EXPECT_NEAR(s.y_min(), -0.2e-3, 1e-15);
}

TEST(Block, Errors) {
  EXPECT_EQ(Stock::block({0, 0, 0}, {1e-3, 1e-3, 0}, 1e-4).error().id, "CT110");
  EXPECT_EQ(Stock::block({0, 0, 0}, {1e-3, -1e-3, 1e-3}, 1e-4).error().id, "CT110");
  EXPECT_EQ(Stock::block({0, 0, 0}, {1e-3, 1e-3, 1e-3}, 0).error().id, "CT110");
  EXPECT_EQ(Stock::block({0, 0, 0}, {1e-3, std::nan(""), 1e-3}, 1e-4).error().id, "CT110");
  EXPECT_EQ(Stock::block({0, 0, 0}, {1, 1, 1e-3}, 1e-4, 1000).error().id, "CT111");
  EXPECT_EQ(Stock::block({0, 0, 0}, {1e300, 1e300, 1}, 1e-4).error().id, "CT111");
}

TEST(FromLayers, RefusesWhatIsNoStock) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const auto layers = [](float first, float second) {
    std::vector<float> all(2 * Stock::kLayers, first);
    std::fill_n(all.begin() + Stock::kLayers, Stock::kLayers, second);
    return all;
  };
  const auto s = Stock::from_layers(0, 0, 1, 2, 1, 0, 1, layers(1, Stock::empty()));
  ASSERT_TRUE(s);
  EXPECT_EQ(s->volume(), 1);
  EXPECT_EQ(s->height(1, 0), Stock::empty());
  EXPECT_EQ(Stock::from_layers(0, 0, 1, 2, 1, 0, 1, {1}).error().id, "CT123");
  EXPECT_EQ(Stock::from_layers(0, 0, 1, 2, 1, 0, 1, layers(1, nan)).error().id, "CT123");
  EXPECT_EQ(Stock::from_layers(0, 0, 1, 2, 1, 0, 1, layers(1, 2)).error().id, "CT123");
  EXPECT_EQ(Stock::from_layers(0, 0, 0, 2, 1, 0, 1, layers(1, 1)).error().id, "CT123");
  EXPECT_EQ(Stock::from_layers(0, 0, 1, 2, 1, 1, 1, layers(1, 1)).error().id, "CT123");
  for (const double cell : {5e-324, 1e-9, 2.0}) {
    EXPECT_EQ(Stock::from_layers(0, 0, cell, 2, 1, 0, 1, layers(1, 1)).error().id, "CT123") << cell;
  }
  EXPECT_EQ(Stock::from_layers(1e300, 0, 1, 2, 1, 0, 1, layers(1, 1)).error().id, "CT123");
}

TEST(CutDisc, RemovesItsArea) {
  EXPECT_TRUE(rc::check("a disc anywhere in the plate", [] {
    Stock s = plate();
    const double before = s.volume();
    const double removed = s.cut_disc({between(-5e-3, 5e-3), between(-5e-3, 5e-3), -kAp}, kRadius);
    constexpr double kShare = 4e-3;  // what layers leave of the error of a grid (measured up to 2e-3)
    RC_ASSERT(std::abs(removed - kPi * kRadius * kRadius * kAp) <= kShare * kPi * kRadius * kRadius * kAp);
    RC_ASSERT(std::abs(before - s.volume() - removed) <= kSumRounding * removed);  // heights are floats
  }));
}

TEST(CutLine, RemovesItsSweptArea) {
  EXPECT_TRUE(rc::check("a straight slot", [] {
    Stock s = plate();
    const Vec2 a(between(-8e-3, 8e-3), between(-8e-3, 8e-3)), b(between(-8e-3, 8e-3), between(-8e-3, 8e-3));
    const double removed = s.cut_line(at(a, -kAp), at(b, -kAp), kRadius);
    const double area = kPi * kRadius * kRadius + 2 * kRadius * (b - a).norm();
    constexpr double kEdge = 0.08 * kCell;  // m; a wall along the grid is known to a sixteenth of a cell
    const double length = 2 * kPi * kRadius + 2 * (b - a).norm();
    RC_ASSERT(std::abs(removed - area * kAp) <= kEdge * length * kAp);
  }));
}

TEST(CutLine, BelowTheBottomTakesAllThereIs) {
  Stock s = plate(15e-3, -1e-3);
  const double removed = s.cut_line({-5e-3, 0, -9e-3}, {5e-3, 0, -9e-3}, kRadius);
  const double area = kPi * kRadius * kRadius + 2 * kRadius * 10e-3;
  EXPECT_NEAR(removed, area * 1e-3, 2e-3 * area * 1e-3);
  EXPECT_EQ(s.height(s.columns() / 2, s.rows() / 2), Stock::empty());
}

// A column of a plate that was cut from both sides holds what neither side took.
TEST(Turned, HoldsWhatNeitherSideTook) {
  EXPECT_TRUE(rc::check("any cuts on both sides, about either axis", [] {
    const auto about = *rc::gen::element(Stock::Axis::x, Stock::Axis::y);
    const auto somewhere = [](double top) {
      return Vec3(between(-15e-3, 15e-3), between(-15e-3, 15e-3), top - between(-1e-3, 6e-3));
    };
    Stock front = plate(15e-3, -5e-3, 0.5e-3);
    for (int i = 0; i < 4; ++i) front.cut_line(somewhere(0), somewhere(0), kRadius);
    Stock both = front.turned(about);
    RC_ASSERT(std::abs(both.volume() - front.volume()) <= 1e-6 * front.volume());
    Stock back = plate(15e-3, -5e-3, 0.5e-3).turned(about);  // solid: only the second side's cuts
    const double before = both.volume();
    double removed = 0;
    for (int i = 0; i < 4; ++i) {
      const Vec3 a = somewhere(5e-3), b = somewhere(5e-3);
      removed += both.cut_step(a, b, kRadius);
      back.cut_step(a, b, kRadius);
    }
    removed += both.settle();
    back.settle();
    double expected = 0;
    for (int j = 0; j < both.rows(); ++j) {
      for (int i = 0; i < both.columns(); ++i) {
        const int column = about == Stock::Axis::x ? i : both.columns() - 1 - i;
        const int row = about == Stock::Axis::x ? both.rows() - 1 - j : j;
        for (int k = 0; k < Stock::kLayers; ++k) {
          const double to = back.cell_layers(i, j)[k], from = -double{front.cell_layers(column, row)[k]};
          if (std::isfinite(to) && std::isfinite(from)) expected += std::max(0.0, to - from);
        }
      }
    }
    expected *= both.cell() * both.cell() / Stock::kLayers;
    RC_ASSERT(std::abs(both.volume() - expected) <= kSumRounding * before);
    RC_ASSERT(std::abs(before - both.volume() - removed) <= kSumRounding * before);
  }));
}

TEST(Turned, TwiceIsWhatItWas) {
  Stock s = plate();
  s.cut_line({-9e-3, 1e-3, -2e-3}, {20e-3, 3e-3, -6e-3}, kRadius);
  for (const auto about : {Stock::Axis::x, Stock::Axis::y}) {
    const Stock again = s.turned(about).turned(about);
    EXPECT_LE(largest_difference(again, s), kHeightRounding);  // the bottom becomes the top, which is a float
    EXPECT_NEAR(again.volume(), s.volume(), kSumRounding * s.volume());
    EXPECT_NEAR(again.x_min(), s.x_min(), 1e-15);
    EXPECT_NEAR(again.y_min(), s.y_min(), 1e-15);
  }
}

// A plate of 5 mm with 3 mm milled off from below: the cutter meets 2 mm, wherever its tip is below them.
TEST(Turned, TheCutterMeetsWhatTheFirstSideLeft) {
  Stock first = plate();
  first.cut_line({-20e-3, 0, -3e-3}, {20e-3, 0, -3e-3}, 20e-3);
  const Stock s = first.turned(Stock::Axis::y).shifted({0, 0, -5e-3});  // from -5 to 0 mm, hollow up to -2 mm
  EXPECT_NEAR(s.top(), 0, kHeightRounding);
  EXPECT_NEAR(s.bottom(), -5e-3, kHeightRounding);
  for (const double depth : {1.5e-3, 2e-3, 3e-3, 7e-3}) {
    const double met = std::min(depth, 2e-3);
    EngagementProfile profile;
    look_ahead(s, {0, 0, -depth}, kRadius, {0, 1}, 2 * kCell, profile);
    for (const float d : profile.depth) EXPECT_NEAR(d, met, 2 * kHeightRounding);
    Stock slot = s;
    EXPECT_NEAR(slot.cut_disc({0, 0, -depth}, kRadius), kPi * kRadius * kRadius * met,
                4e-3 * kPi * kRadius * kRadius * met);
    EndFootprint footprint;
    look_down(s, {0, 0, -depth}, kRadius, {0, 1}, 0.1e-3, footprint);
    EXPECT_EQ(footprint.any, depth < 2e-3);
    if (depth < 2e-3) {
      EXPECT_NEAR(footprint.mean_length(), kRadius, 1e-3 * kRadius);
    }
  }
  // Above the hollow alone there is nothing at all.
  Stock through = s;
  through.cut_line({-20e-3, 0, -2.5e-3}, {20e-3, 0, -2.5e-3}, 20e-3);
  EngagementProfile profile;
  look_ahead(through, {0, 0, -4e-3}, kRadius, {0, 1}, 2 * kCell, profile);
  EXPECT_FALSE(profile.any);
  EXPECT_EQ(profile.max_depth, 0);
}

TEST(Turned, HalfCellsHoldTheSame) {
  Stock first = plate();
  first.cut_line({-20e-3, 1e-3, -3e-3}, {20e-3, 4e-3, -4e-3}, kRadius);
  const Stock s = first.turned(Stock::Axis::x);
  EXPECT_NEAR(s.in_half_cells().volume(), s.volume(), kSumRounding * s.volume());
}

TEST(CutLine, InTheAirOrOutsideTakesNothing) {
  Stock s = plate();
  EXPECT_EQ(s.cut_line({-5e-3, 0, 1e-3}, {5e-3, 0, 0}, kRadius), 0);
  EXPECT_EQ(s.cut_line({100e-3, 0, -1e-3}, {120e-3, 5e-3, -1e-3}, kRadius), 0);
  EXPECT_EQ(s.cut_line({0, 0, -1e-3}, {std::nan(""), 0, -1e-3}, kRadius), 0);
  EXPECT_EQ(s.cut_line({0, 0, -1e-3}, {1e-3, 0, -1e-3}, 0), 0);
  EXPECT_EQ(largest_difference(s, plate()), 0);
}

TEST(CutLine, HalfOutsideTheGrid) {
  Stock s = plate();
  const double removed = s.cut_line({-30e-3, 15e-3, -kAp}, {30e-3, 15e-3, -kAp}, kRadius);
  EXPECT_NEAR(removed, 30e-3 * kRadius * kAp, 1e-2 * 30e-3 * kRadius * kAp);
}

// A path of 1 to 5 straight pieces; level, or with heights between -4 and +1 mm (above the plate's top at 0).
std::vector<Vec3> path(bool level) {
  std::vector<Vec3> points;
  const int n = *samples::whole(2, 7);
  for (int i = 0; i < n; ++i) {
    points.emplace_back(between(-18e-3, 18e-3), between(-18e-3, 18e-3), level ? -kAp : between(-6e-3, 1e-3));
  }
  return points;
}

TEST(CutLine, StepsDoNotMatter) {
  for (const bool level : {true, false}) {
    EXPECT_TRUE(rc::check(level ? "level steps" : "sloped steps", [level] {
      Stock whole = plate(), steps = plate(), careful = plate();
      const std::vector<Vec3> p = path(level);
      const int n = *samples::whole(1, 60);
      double removed_whole = 0, removed_steps = 0;
      for (std::size_t i = 0; i + 1 < p.size(); ++i) {
        removed_whole += whole.cut_line(p[i], p[i + 1], kRadius);
        careful.cut_line(p[i], p[i + 1], kRadius, i > 0);
        for (int k = 0; k < n; ++k) {
          const Vec3 a = p[i] + (p[i + 1] - p[i]) * k / n, b = p[i] + (p[i + 1] - p[i]) * (k + 1) / n;
          removed_steps += steps.cut_line(a, b, kRadius, i > 0 || k > 0);
        }
      }
      RC_ASSERT(largest_difference(whole, steps) <= kHeightRounding);
      RC_ASSERT(largest_difference(whole, careful) <= kHeightRounding);
      RC_ASSERT(std::abs(removed_whole - removed_steps) <= kSumRounding * removed_whole + 1e-15);
    }));
  }
}

TEST(CutLine, SlopedIsTheLowestOfItsDiscs) {
  // An oracle of its own: many discs on the way. The ramp holds each of them; and discs that are larger by more than
  // half their spacing hold the ramp, to half the fall between two of them.
  EXPECT_TRUE(rc::check("ramps between discs", [] {
    Stock ramp = plate(10e-3), discs = plate(10e-3), larger_discs = plate(10e-3);
    const Vec3 a(between(-8e-3, 8e-3), between(-8e-3, 8e-3), between(-6e-3, 1e-3));
    const Vec3 b(between(-8e-3, 8e-3), between(-8e-3, 8e-3), between(-6e-3, 1e-3));
    ramp.cut_line(a, b, kRadius);
    constexpr int kDiscs = 300;
    const double dz = std::abs(a.z() - b.z()) / kDiscs, ds = (a - b).head<2>().norm() / kDiscs;
    for (int k = 0; k <= kDiscs; ++k) {
      discs.cut_disc(a + (b - a) * k / kDiscs, kRadius);
      larger_discs.cut_disc(a + (b - a) * k / kDiscs, kRadius + 0.6 * ds + 1e-9);
    }
    for (std::size_t i = 0; i < ramp.layers().size(); ++i) {
      const double level = std::max<double>(ramp.layers()[i], ramp.bottom());
      RC_ASSERT(level <= std::max<double>(discs.layers()[i], ramp.bottom()) + kHeightRounding);
      RC_ASSERT(level >= std::max<double>(larger_discs.layers()[i], ramp.bottom()) - 0.5 * dz - kHeightRounding);
    }
  }));
}

TEST(CutLine, PlungeIsTheDiscAtItsEnd) {
  Stock plunge = plate(), disc = plate();
  plunge.cut_line({1e-3, 2e-3, 3e-3}, {1e-3, 2e-3, -3e-3}, kRadius);
  disc.cut_disc({1e-3, 2e-3, -3e-3}, kRadius);
  EXPECT_LE(largest_difference(plunge, disc), kHeightRounding);
}

/// Places of a tip that goes down, up, on a level and straight down, below the bottom and above the top too.
std::vector<Vec3> wandering() {
  std::vector<Vec3> p{Vec3(between(-8e-3, 8e-3), between(-8e-3, 8e-3), between(-2e-3, 1e-3))};
  const int n = *samples::whole(2, 30);
  for (int i = 0; i < n; ++i) {
    const int kind = *samples::whole(0, 4);
    const Vec3 step(between(-1e-3, 1e-3), between(-1e-3, 1e-3), between(-0.5e-3, 0.5e-3));
    const double down = -std::abs(step.z());
    p.push_back(p.back() + (kind == 0   ? Vec3(0, 0, 2 * down)
                            : kind == 1 ? step
                            : kind == 2 ? Vec3(step.x(), step.y(), 0)
                                        : Vec3(step.x(), step.y(), down)));
  }
  return p;
}

TEST(CutStep, IsCutLineOnceItIsSettledAndLooksLikeItBefore) {
  // What a way down leaves standing is seen by nobody, wherever the deflected tool looks from.
  EXPECT_TRUE(rc::check("steps", [] {
    Stock whole = plate(10e-3), steps = plate(10e-3);
    double removed_whole = 0, removed_steps = 0;
    const std::vector<Vec3> p = wandering();
    for (std::size_t i = 0; i + 1 < p.size(); ++i) {
      removed_whole += whole.cut_line(p[i], p[i + 1], kRadius, i > 0);
      removed_steps += steps.cut_step(p[i], p[i + 1], kRadius, i > 0);
      const Vec3 tip = p[i + 1] + Vec3(between(-2, 2) * kCell, between(-2, 2) * kCell, between(-3e-4, 0));
      const Vec2 f = direction(between(-kPi, kPi));
      EngagementProfile a, b;
      look_ahead(whole, tip, kRadius, f, 2 * kCell, a);
      look_ahead(steps, tip, kRadius, f, 2 * kCell, b);
      RC_ASSERT(a.any == b.any && a.max_depth == b.max_depth);
      RC_ASSERT(std::equal(a.depth, a.depth + EngagementProfile::kBins, b.depth));
      EndFootprint down_a, down_b;
      look_down(whole, tip, kRadius, f, 1e-4, down_a);
      look_down(steps, tip, kRadius, f, 1e-4, down_b);
      RC_ASSERT(down_a.any == down_b.any && down_a.length == down_b.length);
    }
    removed_steps += steps.settle();
    RC_ASSERT(whole.layers() == steps.layers());
    RC_ASSERT(std::abs(removed_whole - removed_steps) <= kSumRounding * removed_whole + 1e-15);
  }));
}

TEST(LookAhead, ASecondPassMeetsExactlyNothing) {
  for (const bool level : {true, false}) {
    EXPECT_TRUE(rc::check(level ? "level" : "sloped", [level] {
      Stock s = plate();
      const std::vector<Vec3> p = path(level);
      const int n = *samples::whole(1, 40);
      for (std::size_t i = 0; i + 1 < p.size(); ++i) {
        for (int k = 0; k < n; ++k) {
          const Vec3 a = p[i] + (p[i + 1] - p[i]) * k / n, b = p[i] + (p[i + 1] - p[i]) * (k + 1) / n;
          s.cut_line(a, b, kRadius, k > 0);
        }
      }
      for (std::size_t i = 0; i + 1 < p.size(); ++i) {
        const Vec3 way = p[i + 1] - p[i];
        const double length = way.head<2>().norm();
        if (length < 1e-4) continue;
        for (int k = 0; k < 37; ++k) {
          const double t = k / 37.0, ahead = std::min(2 * kCell, (1 - t) * length);
          // On a ramp down the flat step ahead stays above what the ramp took; on a ramp up look along from the step's
          // end.
          const Vec3 tip(p[i].x() + t * way.x(), p[i].y() + t * way.y(),
                         std::max(p[i].z() + t * way.z(), p[i].z() + (t + ahead / length) * way.z()));
          EngagementProfile profile;
          look_ahead(s, tip, kRadius, way.head<2>() / length, ahead, profile);
          RC_ASSERT(!profile.any);
          RC_ASSERT(profile.max_depth == 0);
          RC_ASSERT(
              std::all_of(profile.depth, profile.depth + EngagementProfile::kBins, [](float d) { return d == 0; }));
        }
      }
      double again = 0;
      for (std::size_t i = 0; i + 1 < p.size(); ++i) again += s.cut_line(p[i], p[i + 1], kRadius);
      RC_ASSERT(again <= 1e-13);  // m^3: the rounding of 20 000 heights; the path took up to 1e-6
    }));
  }
}

TEST(LookAhead, ASecondPassMeetsNothingWhereRoundingDecides) {
  // Ways beside a cell that lies on the very limit of a layer: its distance is that at which the disc covers
  // (k + 1/2 - 0.0137) / 8 of the cell. Looked at from where the step ahead ends beside the cell.
  for (int k = 0; k < Stock::kLayers; ++k) {
    const double share = (k + 0.5 - 0.0137) / Stock::kLayers;
    const double distance = std::sqrt(kRadius * kRadius - (share - 0.5) * 2 * kRadius * kCell);
    for (int degrees = 0; degrees < 360; ++degrees) {
      const Vec2 f = direction(units::from_deg(degrees)), n = left_of(f);
      Stock s = plate(8e-3);
      const Vec2 cell(s.x_min() + (35 + degrees % 11 + 0.5) * kCell, s.y_min() + (35 + degrees % 7 + 0.5) * kCell);
      const Vec2 foot = cell - distance * n;
      s.cut_line(at(foot - 7e-3 * f, -kAp), at(foot + 6e-3 * f, -kAp), kRadius);
      EngagementProfile profile;
      look_ahead(s, at(foot - 2 * kCell * f, -kAp), kRadius, f, 2 * kCell, profile);
      EXPECT_FALSE(profile.any) << "layer " << k << ", " << degrees << " degrees";
    }
  }
}

struct Straight {
  double share;          // ae / D
  double median, worst;  // of |F - F0| / |F0|, bounds just above what is measured (docs/cutting.md)
};

// Forces from the stock against the closed form: the side that is free is cut by an earlier pass, in every direction
// and with the grid at different places under the path.
class StraightCut : public testing::TestWithParam<Straight> {};

TEST_P(StraightCut, ForceAgreesWithTheClosedForm) {
  const Cutter cutter = end_mill();
  const ProfileForce tabulated(cutter, aluminium());
  for (const CutSide side : {CutSide::down, CutSide::up}) {
    const double ae = GetParam().share * cutter.diameter, sign = side == CutSide::down ? 1 : -1;
    const Vec3 closed = mean_force(cutter, aluminium(), straight_engagement(cutter, side, ae, kAp), kFeed);
    std::vector<double> errors;
    for (int degrees = 0; degrees < 360; degrees += 9) {
      for (int phase = 0; phase < 5; ++phase) {
        const Vec2 f = direction(units::from_deg(degrees)), n = left_of(f);
        const Vec2 tip = (0.2 * phase * n + 0.13 * phase * f) * kCell, to_free = sign * n;
        Stock s = plate();
        for (int pass = 0; GetParam().share < 1 && pass < 2; ++pass) {
          const Vec2 centre = tip + to_free * (ae + pass * kRadius);
          s.cut_line(at(centre - f * 20e-3, -kAp), at(centre + f * 20e-3, -kAp), kRadius);
        }
        s.cut_line(at(tip - f * 12e-3, -kAp), at(tip, -kAp), kRadius);
        EngagementProfile profile;
        look_ahead(s, at(tip, -kAp), kRadius, f, 2 * kCell, profile);
        ASSERT_TRUE(profile.any);
        EXPECT_NEAR(profile.max_depth, kAp, kHeightRounding);
        errors.push_back((tabulated.mean_force(profile, kFeed) - closed).norm() / closed.norm());
      }
    }
    std::sort(errors.begin(), errors.end());
    const std::string name = side == CutSide::down ? "down" : "up";
    RecordProperty(name + "_median", std::to_string(errors[errors.size() / 2]));
    RecordProperty(name + "_worst", std::to_string(errors.back()));
    EXPECT_LE(errors[errors.size() / 2], GetParam().median) << "side " << int(side);
    EXPECT_LE(errors.back(), GetParam().worst) << "side " << int(side);
  }
}

INSTANTIATE_TEST_SUITE_P(Shares, StraightCut,
                         testing::Values(Straight{0.05, 0.018, 0.065}, Straight{0.1, 0.008, 0.035},
                                         Straight{0.2, 0.0045, 0.02}, Straight{0.35, 0.003, 0.015},
                                         Straight{0.5, 0.003, 0.01}, Straight{0.75, 0.003, 0.01},
                                         Straight{1.0, 1e-6, 1e-6}));

TEST(LookAhead, StraightEdgeOfTheBlock) {
  // Half of the cutter over the edge of a block whose edge is an edge of cells: no earlier pass.
  Stock s = plate();
  const Vec3 tip(0, 15e-3, -kAp);  // material on the right of +x
  s.cut_line({-25e-3, 15e-3, -kAp}, tip, kRadius);
  EngagementProfile profile;
  look_ahead(s, tip, kRadius, {1, 0}, 2 * kCell, profile);
  const Cutter cutter = end_mill();
  const Vec3 closed = mean_force(cutter, aluminium(), straight_engagement(cutter, CutSide::down, kRadius, kAp), kFeed);
  const Vec3 force = ProfileForce(cutter, aluminium()).mean_force(profile, kFeed);
  constexpr double kShare = 2e-3;
  EXPECT_LE((force - closed).norm(), kShare * closed.norm());
}

TEST(LookAhead, DoesNotNeedTheDiscAtTheTipToBeCut) {
  Stock uncut = plate(), cut = plate();
  const Vec3 tip(0.3e-3, -0.4e-3, -kAp);
  cut.cut_disc(tip, kRadius);
  EngagementProfile a, b;
  look_ahead(uncut, tip, kRadius, direction(0.7), 2 * kCell, a);
  look_ahead(cut, tip, kRadius, direction(0.7), 2 * kCell, b);
  for (int j = 0; j < EngagementProfile::kBins; ++j) EXPECT_NEAR(a.depth[j], b.depth[j], 1e-7);
}

TEST(LookAhead, AStepInTheStock) {
  // The right half of the way is 1 mm lower: two depths side by side.
  Stock s = plate();
  s.cut_line({-30e-3, -12e-3, -1e-3}, {30e-3, -12e-3, -1e-3}, 12e-3);
  const Vec3 tip(0, 0, -3e-3);
  s.cut_line({-20e-3, 0, -3e-3}, tip, kRadius);
  EngagementProfile profile;
  look_ahead(s, tip, kRadius, {1, 0}, 2 * kCell, profile);
  EXPECT_NEAR(profile.max_depth, 3e-3, 1e-8);
  const int half = EngagementProfile::kBins / 2;
  constexpr int kOneCell = 2;  // strips
  for (int j = kOneCell; j < half - kOneCell; ++j) EXPECT_NEAR(profile.depth[j], 3e-3, 1e-6) << j;
  // Below the top of the stock the curved edge is half a cell further in: single strips are uneven, their mean is not.
  double mean = 0;
  for (int j = half + kOneCell; j < 2 * half - kOneCell; ++j) mean += profile.depth[j] / (half - 2 * kOneCell);
  EXPECT_NEAR(mean, 2e-3, 0.02 * 2e-3);

  const auto discs = by_disc(profile, 0.025 * 2 * kRadius);
  ASSERT_EQ(discs.size(), 15u);
  ASSERT_EQ(discs.front().spans.size(), 1u);
  EXPECT_EQ(discs.front().spans[0].entry, 0);
  EXPECT_NEAR(discs.front().spans[0].exit, kPi, 1e-12);
  ASSERT_EQ(discs.back().spans.size(), 1u);
  EXPECT_NEAR(discs.back().spans[0].exit, kPi / 2, 0.05);  // one strip is 0.03 rad there
}

TEST(LookAhead, DepthEndsAtTheBottom) {
  Stock s = plate(15e-3, -1e-3);
  EngagementProfile profile;
  look_ahead(s, {0, 0, -7e-3}, kRadius, {0, 1}, 2 * kCell, profile);
  EXPECT_NEAR(profile.max_depth, 1e-3, 1e-9);
  for (const float d : profile.depth) EXPECT_NEAR(d, 1e-3, 1e-9);
}

TEST(LookAhead, ASlotIsFullInEveryStrip) {
  EXPECT_TRUE(rc::check("any direction, grid and step", [] {
    const double cell = between(0.3, 1) * kCell, angle = between(0, 2 * kPi);
    const Stock s = plate(15e-3, -5e-3, cell);
    EngagementProfile profile;
    look_ahead(s, {between(-5e-3, 5e-3), between(-5e-3, 5e-3), -kAp}, kRadius, direction(angle), between(0.5, 4) * cell,
               profile);
    RC_ASSERT(profile.any);
    for (const float d : profile.depth) RC_ASSERT(std::abs(d - kAp) <= kHeightRounding);
  }));
}

TEST(LookAhead, ForceFollowsASmallShiftSmoothly) {
  // The cutter pushed off the wall by up to a cell, as by its own force: the width of cut falls by as much. An
  // equilibrium needs this without steps.
  const Cutter cutter = end_mill();
  const ProfileForce tabulated(cutter, aluminium());
  const Vec2 f = direction(0.3), n = left_of(f);
  Stock s = plate();
  for (int pass = 0; pass < 2; ++pass) {
    const Vec2 c = n * (kRadius + pass * kRadius);
    s.cut_line(at(c - f * 20e-3, -kAp), at(c + f * 20e-3, -kAp), kRadius);
  }
  for (int k = 0; k <= 20; ++k) {
    const double shift = k * kCell / 20;
    EngagementProfile profile;
    look_ahead(s, at(shift * n, -kAp), kRadius, f, 2 * kCell, profile);
    const Vec3 closed =
        mean_force(cutter, aluminium(), straight_engagement(cutter, CutSide::down, kRadius - shift, kAp), kFeed);
    constexpr double kShare = 0.01;
    EXPECT_LE((tabulated.mean_force(profile, kFeed) - closed).norm(), kShare * closed.norm()) << k;
  }
}

TEST(LookAhead, NothingThere) {
  const Stock s = plate();
  const double nan = std::nan("");
  EngagementProfile profile;
  const auto meets = [&](const Vec3& tip, double radius, const Vec2& feed, double ahead) {
    profile.any = true;
    look_ahead(s, tip, radius, feed, ahead, profile);
    return profile.any;
  };
  EXPECT_FALSE(meets({0, 0, 0}, kRadius, {1, 0}, 2 * kCell));          // on the top
  EXPECT_FALSE(meets({60e-3, 0, -1e-3}, kRadius, {1, 0}, 2 * kCell));  // beside
  EXPECT_FALSE(meets({0, 0, -1e-3}, kRadius, {0, 0}, 2 * kCell));
  EXPECT_FALSE(meets({0, 0, -1e-3}, kRadius, {1, 0}, 0));
  EXPECT_FALSE(meets({0, 0, -1e-3}, 0, {1, 0}, 2 * kCell));
  EXPECT_FALSE(meets({nan, 0, -1e-3}, kRadius, {1, 0}, 2 * kCell));
  EXPECT_FALSE(meets({0, 0, -1e-3}, kRadius, {nan, 0}, 2 * kCell));
  EXPECT_TRUE(meets({0, 0, -1e-3}, kRadius, {1, 0}, 2 * kCell));
}

TEST(LookAhead, TakesOnlyWhatTheStepTakes) {
  // Summed over small steps the strips' depths are the removed volume.
  Stock s = plate();
  Vec3 tip(-6e-3, 1e-3, -kAp);
  const Vec2 f = direction(0.4);
  s.cut_disc(tip, kRadius);
  double looked = 0, removed = 0;
  const double step = 2 * kCell;
  for (int k = 0; k < 25; ++k) {
    EngagementProfile profile;
    look_ahead(s, tip, kRadius, f, step, profile);
    for (const float d : profile.depth) looked += d * (2 * kRadius / EngagementProfile::kBins) * step;
    const Vec3 next = tip + Vec3(f.x() * step, f.y() * step, 0);
    removed += s.cut_line(tip, next, kRadius, true);
    tip = next;
  }
  constexpr double kShare = 5e-3;
  EXPECT_NEAR(looked, removed, kShare * removed);
}

TEST(LookAhead, SecondLevelOfAPocket) {
  // Levels below the first one: the floor is lower than the top of the stock, where walls are half a cell nearer.
  const Cutter cutter = end_mill();
  const ProfileForce tabulated(cutter, aluminium());
  std::vector<double> errors;
  for (int degrees = 0; degrees < 180; degrees += 7) {
    const Vec2 f = direction(units::from_deg(degrees)), n = left_of(f);
    Stock s = plate(15e-3, -8e-3);
    for (int pass = -4; pass <= 4; ++pass) {  // the first level clears a floor of 40 mm
      const Vec2 c = n * (pass * kRadius);
      s.cut_line(at(c - f * 30e-3, -kAp), at(c + f * 30e-3, -kAp), kRadius);
    }
    for (int pass = 0; pass < 2; ++pass) {
      const Vec2 c = n * (kRadius + pass * kRadius);
      s.cut_line(at(c - f * 30e-3, -2 * kAp), at(c + f * 30e-3, -2 * kAp), kRadius);
    }
    s.cut_line(at(-f * 20e-3, -2 * kAp), at({0, 0}, -2 * kAp), kRadius);
    EngagementProfile profile;
    look_ahead(s, {0, 0, -2 * kAp}, kRadius, f, 2 * kCell, profile);
    const Vec3 closed =
        mean_force(cutter, aluminium(), straight_engagement(cutter, CutSide::down, kRadius, kAp), kFeed);
    errors.push_back((tabulated.mean_force(profile, kFeed) - closed).norm() / closed.norm());
  }
  std::sort(errors.begin(), errors.end());
  EXPECT_LE(errors[errors.size() / 2], 0.02);
  EXPECT_LE(errors.back(), 0.03);
}

TEST(ProfileForce, FullProfileIsTheSlot) {
  for (const double exponent : {1.0, 0.6}) {
    Material m = aluminium();
    m.exponent = exponent;
    EngagementProfile profile;
    std::fill(profile.depth, profile.depth + EngagementProfile::kBins, static_cast<float>(kAp));
    profile.any = true;
    profile.max_depth = kAp;
    const Vec3 slot = mean_force(end_mill(), m, {0, kPi, kAp}, kFeed);
    EXPECT_LE((ProfileForce(end_mill(), m).mean_force(profile, kFeed) - slot).norm(), 1e-6 * slot.norm());
  }
}

TEST(ProfileForce, CounterclockwiseIsTheMirrorImage) {
  const Cutter cutter = end_mill();
  EngagementProfile left{}, right{};
  left.any = right.any = true;
  for (int j = 0; j < 20; ++j) left.depth[j] = right.depth[EngagementProfile::kBins - 1 - j] = 1e-3f;
  const ProfileForce force(cutter, aluminium());
  const Vec3 up = force.mean_force(left, kFeed);
  const Vec3 mirrored = force.mean_force(right, kFeed, Spindle::counterclockwise);
  EXPECT_LE((mirrored - Vec3(up.x(), -up.y(), up.z())).norm(), 1e-9);
}

TEST(ByDisc, HistoryHasTheMeanOfTheProfile) {
  const Cutter cutter = end_mill();
  EngagementProfile profile{};
  profile.any = true;
  profile.max_depth = 3e-3;
  for (int j = 10; j < 30; ++j) profile.depth[j] = 1e-3f;
  for (int j = 40; j < EngagementProfile::kBins; ++j) profile.depth[j] = 3e-3f;
  const auto discs = by_disc(profile, 0.2e-3);
  ASSERT_EQ(discs.size(), 15u);
  EXPECT_EQ(discs[0].spans.size(), 2u);
  EXPECT_EQ(discs[14].spans.size(), 1u);
  double depth = 0;
  for (const auto& disc : discs) depth += disc.spans.back().depth;
  EXPECT_NEAR(depth, 3e-3, 1e-12);
  const Vec3 history = force_history(cutter, aluminium(), discs, kFeed).mean;
  const Vec3 mean = ProfileForce(cutter, aluminium()).mean_force(profile, kFeed);
  EXPECT_LE((history - mean).norm(), 1e-3 * mean.norm());
}

TEST(ByDisc, EmptyProfileHasNoDiscs) {
  EXPECT_TRUE(by_disc(EngagementProfile{}, 1e-4).empty());
  EngagementProfile profile{};
  profile.any = true;
  profile.max_depth = 1e-3;
  EXPECT_TRUE(by_disc(profile, 0).empty());
}

}  // namespace
}  // namespace polypod::cutting
