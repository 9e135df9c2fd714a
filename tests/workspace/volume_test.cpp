// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/workspace/volume.hpp"

#include <gmock/gmock.h>

#include <random>

#include "machines.hpp"

#include "polypod/core/units.hpp"
#include "polypod/families/hexapod/strut_kinematics.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod::workspace {
namespace {

using test::congruent;
using test::load;

Options at_tilt(double deg, double tolerance = 0.01) {
  Options options;
  options.directions.tilt = units::from_deg(deg);
  options.relative_tolerance = tolerance;
  return options;
}

Volume run(const AnyMachine& m, const Options& options) {
  const auto v = volume(m, options);
  EXPECT_TRUE(v) << (v ? "" : to_string(v.error()));
  return *v;
}

// At a fixed orientation the struts' lengths alone leave the points within all shells l_min <= |p - c_i| <= l_max. With
// all centres at one height the volume is twice the integral over x, y of the free height; the rest is quadrature,
// whose error (first order only at the edges of the region) is below 1e-4 at 2000 x 2000.
double shells(const machine::StrutHexapod& m) {
  std::vector<Vec3> c;
  for (int i = 0; i < machine::kLegs; ++i) c.push_back(m.base_joint[i] - m.platform_joint[i]);
  const double reach = m.length_max + 0.1;
  constexpr int kSteps = 2000;
  const double step = 2 * reach / kSteps;
  double sum = 0;
  for (int i = 0; i < kSteps; ++i)
    for (int j = 0; j < kSteps; ++j) {
      const double x = -reach + (i + 0.5) * step, y = -reach + (j + 0.5) * step;
      double near = 1e9, far = 0;
      for (const Vec3& center : c) {
        const double d2 = (x - center.x()) * (x - center.x()) + (y - center.y()) * (y - center.y());
        near = std::min(near, d2);
        far = std::max(far, d2);
      }
      const double high2 = m.length_max * m.length_max - far, low2 = m.length_min * m.length_min - near;
      if (high2 > 0) sum += std::max(0.0, std::sqrt(high2) - std::sqrt(std::max(0.0, low2)));
    }
  return 2 * sum * step * step;
}
constexpr double kQuadrature = 1e-4;

Options lengths_only(const AnyMachine& m, double tolerance) {
  Options options = at_tilt(0, tolerance);
  options.limits &= ~*limit_bits(m, "joint");
  return options;
}

TEST(Volume, CongruentPlatformsGiveTheShell) {
  // Congruent: the platform's joints under the base's, so all struts are parallel; general points, because paired
  // circles of base and platform are turned against each other.
  const AnyMachine m = congruent();
  const Volume v = run(m, lengths_only(m, 1e-3));
  const double shell = 4.0 / 3 * std::numbers::pi * (std::pow(0.09, 3) - std::pow(0.05, 3));
  EXPECT_LE(v.lower, shell);
  EXPECT_GE(v.upper, shell);
  EXPECT_LE(v.upper - v.lower, 1e-3 * v.volume);
  EXPECT_TRUE(v.converged);
  EXPECT_NEAR(v.max.x(), 0.09, 2e-4);  // the shell's outer radius, to about a border cell
  EXPECT_NEAR(v.min.z(), -0.08, 2e-4);
}

TEST(Volume, OctahedronGivesThreeShells) {
  // Double joints on equal circles: the six centres a_i - b_i fall together in pairs.
  const AnyMachine m = load("hexapod-double", {{"platform.radius_mm", "50"}});
  const Volume v = run(m, lengths_only(m, 1e-3));
  const double expected = shells(std::get<machine::StrutHexapod>(m));
  EXPECT_LE(v.lower, expected * (1 + kQuadrature));
  EXPECT_GE(v.upper, expected * (1 - kQuadrature));
}

TEST(Volume, SixShellsOfTheBasicHexapod) {
  const AnyMachine m = load("hexapod-strut");
  const Volume v = run(m, lengths_only(m, 1e-3));
  const double expected = shells(std::get<machine::StrutHexapod>(m));
  EXPECT_LE(v.lower, expected * (1 + kQuadrature));
  EXPECT_GE(v.upper, expected * (1 - kQuadrature));
}

TEST(Volume, BoundsTightenAroundEachOther) {
  for (const char* name : {"hexapod-strut", "hexapod-slider"}) {
    const AnyMachine m = load(name);
    Volume coarse = run(m, at_tilt(10, 0.2));
    for (const double tolerance : {0.1, 0.05}) {
      const Volume fine = run(m, at_tilt(10, tolerance));
      EXPECT_TRUE(fine.converged);
      EXPECT_LE(fine.upper - fine.lower, tolerance * fine.volume);
      // Both are true of one number.
      EXPECT_LE(std::max(fine.lower, coarse.lower), std::min(fine.upper, coarse.upper)) << name;
      coarse = fine;
    }
  }
}

TEST(Volume, SameBitsWithAnyNumberOfThreads) {
  const AnyMachine m = load("hexapod-strut");
  std::vector<Volume> results;
  for (const int threads : {1, 2, 8}) {
    Options options = at_tilt(15, 0.05);
    options.threads = threads;
    options.keep_cells = true;
    results.push_back(run(m, options));
  }
  for (const Volume& v : results) {
    EXPECT_EQ(v.lower, results[0].lower);
    EXPECT_EQ(v.upper, results[0].upper);
    EXPECT_EQ(v.points, results[0].points);
    EXPECT_EQ(v.min, results[0].min);
    EXPECT_EQ(v.max, results[0].max);
    ASSERT_EQ(v.cells.size(), results[0].cells.size());
    for (std::size_t i = 0; i < v.cells.size(); i += 101) EXPECT_EQ(v.cells[i].lower, results[0].cells[i].lower);
  }
}

// Points of cells that are inside, in random directions of the cone; points of the box outside all cells fail in some
// direction of a fine rim.
TEST(Volume, CellsSayWhatTheInverseSays) {
  std::mt19937 random(20260904);
  std::uniform_real_distribution<double> unit(-1, 1);
  for (const char* name : {"hexapod-strut", "hexapod-slider"}) {
    const AnyMachine m = load(name);
    Options options = at_tilt(20, 0.2);
    options.keep_cells = true;
    const Volume v = run(m, options);
    ASSERT_GT(v.cells.size(), 100u);
    const LimitBits heeded = ~interference_bits(m);
    const auto reached = [&](const Vec3& p, double tilt, double azimuth) {
      const Pose X{rotation_of(tilt * Vec3(-std::sin(azimuth), std::cos(azimuth), 0)), p};
      const auto result = kinematics::inverse(m, X);
      return !result.solutions.empty() && (result.solutions[0].violations & heeded) == 0;
    };
    int tried = 0;
    for (const Cell& cell : v.cells) {
      if (cell.state != CellState::inside || tried > 3000) continue;
      ++tried;
      const Vec3 p = cell.center + Vec3(unit(random), unit(random), unit(random)).cwiseProduct(cell.half);
      const double tilt = tried % 2 == 0 ? options.directions.tilt : options.directions.tilt * std::abs(unit(random));
      EXPECT_TRUE(reached(p, tilt, 4 * unit(random))) << name << " " << p.transpose();
    }
    EXPECT_GT(tried, 100);
    int outside = 0;
    for (int k = 0; k < 3000; ++k) {
      const Vec3 p =
          0.5 * (v.min + v.max) + 0.7 * Vec3(unit(random), unit(random), unit(random)).cwiseProduct(v.max - v.min);
      const bool in_cell = std::any_of(v.cells.begin(), v.cells.end(), [&](const Cell& cell) {
        return ((p - cell.center).cwiseAbs() - cell.half).maxCoeff() <= 0;
      });
      if (in_cell) continue;
      ++outside;
      bool all = reached(p, 0, 0);
      for (int j = 0; j < 72 && all; ++j) all = reached(p, options.directions.tilt, 2 * std::numbers::pi * j / 72);
      EXPECT_FALSE(all) << name << " " << p.transpose();
    }
    EXPECT_GT(outside, 500);
  }
}

TEST(Volume, APlainScanAgrees) {
  const AnyMachine m = load("hexapod-strut");
  const Volume v = run(m, at_tilt(0, 0.01));
  const double scanned = scan_volume(m, at_tilt(0), v.min, v.max, 60);
  // A regular scan of 60^3 points: error about one part in 60 per face at random, far less in the mean.
  EXPECT_NEAR(scanned / v.volume, 1, 0.01);
}

TEST(Volume, MoreDirectionsAndMoreLimitsLeaveLess) {
  const AnyMachine m = load("hexapod-strut");
  double last = 1e9;
  for (const double tilt : {0.0, 5.0, 10.0, 20.0}) {
    const Volume v = run(m, at_tilt(tilt, 0.05));
    EXPECT_LT(v.upper, last) << tilt;
    last = v.lower;
  }
  const Volume all = run(m, at_tilt(0, 0.02));
  for (const char* off : {"length", "joint"}) {
    Options options = at_tilt(0, 0.02);
    options.limits &= ~*limit_bits(m, off);
    if (std::string(off) == "length") options.limits |= LimitBits{0x3F} << 6;  // some outer bound must stay
    EXPECT_GT(run(m, options).lower, all.upper) << off;
  }
}

TEST(Volume, InterferenceTakesAwayAndThinLegsTakeNothing) {
  const AnyMachine thick = load("hexapod-strut", {{"leg.diameter_mm", "12.4"}});
  Options options = at_tilt(0, 0.01);  // the legs take some per cent
  const Volume free = run(thick, options);
  options.interference = true;
  const Volume thick_legs = run(thick, options);
  EXPECT_LT(thick_legs.upper, free.lower);
  const Volume thin_legs = run(load("hexapod-strut", {{"leg.diameter_mm", "3"}}), options);
  EXPECT_NEAR(thin_legs.volume / free.volume, 1, 0.05);
  // Against a scan, which judges the segments' true distance.
  const double scanned = scan_volume(thick, options, thick_legs.min, thick_legs.max, 60);
  EXPECT_NEAR(scanned / thick_legs.volume, 1, 0.05);
}

TEST(Volume, EmptyIsProven) {
  const Volume v = run(load("hexapod-strut", {{"joint.cone_deg", "15"}}), at_tilt(20));
  EXPECT_TRUE(v.empty);
  EXPECT_EQ(v.upper, 0);
  EXPECT_TRUE(v.converged);
}

TEST(Volume, RangesOfAAndBWithinAConeHoldMoreThanTheCone) {
  const AnyMachine m = load("hexapod-strut");
  Options ranges = at_tilt(0, 0.05);
  const double half = units::from_deg(10) / std::numbers::sqrt2;  // a square inside the disc of tilts
  ranges.directions.a_range = ranges.directions.b_range = std::array<double, 2>{-half, half};
  // The square's tilts are at most 10 deg (and turned about the axis by less than 1 deg).
  EXPECT_GT(run(m, ranges).upper, run(m, at_tilt(10, 0.05)).lower);
  EXPECT_LT(run(m, ranges).lower, run(m, at_tilt(5, 0.05)).upper);
}

TEST(Volume, BadOptionsAreNamed) {
  const AnyMachine m = load("hexapod-strut");
  const auto error = [&](const Options& options) {
    const auto v = volume(m, options);
    EXPECT_FALSE(v);
    return v ? "" : v.error().id;
  };
  EXPECT_EQ(error(at_tilt(90)), "WS100");
  EXPECT_EQ(error(at_tilt(-1)), "WS100");
  EXPECT_EQ(error(at_tilt(std::nan(""))), "WS100");
  EXPECT_EQ(error(at_tilt(0, 0)), "WS101");
  Options options = at_tilt(10);
  options.directions.a_range = std::array<double, 2>{0, 0.1};
  EXPECT_EQ(error(options), "WS100");
  options = at_tilt(0);
  options.directions.a_range = std::array<double, 2>{0.1, 0};
  EXPECT_EQ(error(options), "WS100");
  options = at_tilt(0);
  options.cancelled = [] { return true; };
  EXPECT_EQ(error(options), "WS110");
  EXPECT_EQ(limit_bits(m, "legz").error().id, "WS103");
}

}  // namespace
}  // namespace polypod::workspace
