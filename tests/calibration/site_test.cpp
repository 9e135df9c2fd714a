// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/calibration/site.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "paths.hpp"
#include "polypod/calibration/poses.hpp"
#include "polypod/core/random.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod::calibration {
namespace {

/// Three slides, drawn as lines along x, y and z at the height 0.3 m of the places below.
AnyMachine gantry() {
  const auto m = machine::load(test::source("tests/trials/soft_slides.toml"));
  EXPECT_TRUE(m) << to_string(m.error());
  return *m;
}
Vec3 place(double x, double y, double z) {
  return {x, y, z - 0.3};
}
Stand at(const AnyMachine& m, const Vec3& of_places) {
  const Vec3 p = place(of_places.x(), of_places.y(), of_places.z());
  const auto solved = kinematics::inverse(m, Pose{Mat3::Identity(), p});
  EXPECT_NE(solved.reachable(), nullptr) << p.transpose();
  return {solved.reachable()->joints, Pose{Mat3::Identity(), p}};
}
std::vector<Stand> some_of(const AnyMachine& m) {
  return {at(m, {0.1, 0.1, 0.1}), at(m, {0.4, 0.3, 0.2}), at(m, {0.2, 0.4, 0.3})};
}

// The vertical slide of the gantry ends at the tip: floor, boxes and line of sight in closed form.
TEST(Site, FloorAndBoxes) {
  const AnyMachine m = gantry();
  Site site;
  site.floor = place(0, 0, 0.05).z();
  site.clearance = 0.02;
  const SiteCheck floor(m, site, {}, some_of(m));
  EXPECT_EQ(floor.of(at(m, {0.2, 0.2, 0.0701})), Hindrance::none);
  EXPECT_EQ(floor.of(at(m, {0.2, 0.2, 0.0699})), Hindrance::floor);

  Site fence;
  fence.keep_out = {{place(0.3, 0.3, -1), place(0.45, 0.5, 0.2)}};
  const SiteCheck check(m, fence, {}, some_of(m));
  EXPECT_EQ(check.of(at(m, {0.4, 0.4, 0.21})), Hindrance::none);
  EXPECT_EQ(check.of(at(m, {0.4, 0.4, 0.19})), Hindrance::box);
  EXPECT_EQ(check.of(at(m, {0.2, 0.4, 0.19})), Hindrance::none);
  // Both places are free, the straight move between them is not; higher up it is.
  EXPECT_EQ(check.free_between(at(m, {0.2, 0.4, 0.1}), at(m, {0.5, 0.4, 0.1})), false);
  EXPECT_EQ(check.free_between(at(m, {0.2, 0.4, 0.25}), at(m, {0.5, 0.4, 0.25})), true);
}

TEST(Site, LineOfSight) {
  const AnyMachine m = gantry();
  Site site;
  site.instrument = place(-2, 0.4, 0.1);
  site.keep_out = {{place(-0.5, 0.3, -1), place(-0.4, 0.5, 0.15)}};  // a post before the machine
  const SiteCheck check(m, site, {}, some_of(m));
  EXPECT_EQ(check.of(at(m, {0.2, 0.4, 0.1})), Hindrance::hidden);
  // Seen above the post: the line passes its edge (-0.5, 0.15) where the target is higher than 0.1 + 0.05 * 2.2 / 1.5.
  EXPECT_EQ(check.of(at(m, {0.2, 0.4, 0.173})), Hindrance::hidden);
  EXPECT_EQ(check.of(at(m, {0.2, 0.4, 0.174})), Hindrance::none);

  // The target looks along +z: at an instrument that stands level it is turned away by 90 deg.
  Site above;
  above.instrument = place(0.2, 0.2, 3);
  above.acceptance = units::from_deg(30);
  EXPECT_EQ(SiteCheck(m, above, {}, some_of(m)).of(at(m, {0.2, 0.2, 0.1})), Hindrance::none);
  above.instrument = place(3, 0.2, 0.1);
  EXPECT_EQ(SiteCheck(m, above, {}, some_of(m)).of(at(m, {0.2, 0.2, 0.1})), Hindrance::turned_away);
  const Pose X_TR{rotation_y(units::from_deg(90)), Vec3::Zero()};
  EXPECT_EQ(SiteCheck(m, above, X_TR, some_of(m)).of(at(m, {0.2, 0.2, 0.1})), Hindrance::none);
}

// A leg between the instrument and a target in the middle below the platform hides it as soon as it is that thick.
TEST(Site, TheMachineHidesItsOwnTarget) {
  const AnyMachine m = *machine::load("hexapod-strut");
  const std::vector<Stand> stands = random_stands(m, 20, 1);
  Site site;
  const Pose home = *kinematics::home_pose(m);
  const Stand stand{kinematics::inverse(m, home).solutions.front().joints, home};
  site.clearance = 0.5e-3;
  int hidden = 0;
  constexpr int kAround = 72;
  for (int k = 0; k < kAround; ++k) {
    const double turn = units::from_deg(360.0 * k / kAround);
    site.instrument = Vec3(std::cos(turn), std::sin(turn), 0.02);  // 1 m away, level with the legs
    Site thick = site;
    thick.clearance = 3e-3;
    const bool thin_hides =
        SiteCheck(m, site, Pose{Mat3::Identity(), Vec3(0, 0, -0.02)}, stands).of(stand) != Hindrance::none;
    const bool thick_hides =
        SiteCheck(m, thick, Pose{Mat3::Identity(), Vec3(0, 0, -0.02)}, stands).of(stand) != Hindrance::none;
    EXPECT_TRUE(thick_hides || !thin_hides);
    hidden += thick_hides ? 1 : 0;
  }
  EXPECT_GT(hidden, 6);
  EXPECT_LT(hidden, kAround - 6);
}

TEST(Site, TheWayIsNearlyTheShortest) {
  const AnyMachine m = gantry();
  Random random(3);
  for (int trial = 0; trial < 20; ++trial) {
    std::vector<Stand> stands;
    for (int k = 0; k < 8; ++k)
      stands.push_back(at(m, {random.uniform(0.05, 0.5), random.uniform(0.05, 0.5), random.uniform(0.05, 0.5)}));
    std::vector<std::size_t> order(stands.size());
    std::iota(order.begin(), order.end(), 0);
    double least = 1e300;
    do {
      double sum = 0;
      for (std::size_t k = 0; k + 1 < order.size(); ++k)
        sum += way_between(m, stands[order[k]].q, stands[order[k + 1]].q);
      least = std::min(least, sum);
    } while (std::next_permutation(order.begin(), order.end()));
    const Way way = shortest_way(m, stands, nullptr);
    std::vector<std::size_t> sorted = way.order;
    std::sort(sorted.begin(), sorted.end());
    for (std::size_t k = 0; k < sorted.size(); ++k) EXPECT_EQ(sorted[k], k);
    EXPECT_GE(way.length, least * (1 - 1e-12));
    EXPECT_LE(way.length, least * 1.05);
  }
}

// Two places on each side of a fence, and one above it: the way goes over the one above, though it is longer.
TEST(Site, TheWayGoesRoundWhatIsInTheWay) {
  const AnyMachine m = gantry();
  const std::vector<Stand> stands{at(m, {0.1, 0.2, 0.1}), at(m, {0.25, 0.2, 0.1}), at(m, {0.43, 0.2, 0.1}),
                                  at(m, {0.5, 0.2, 0.1}), at(m, {0.35, 0.2, 0.45})};
  Site site;
  site.keep_out = {{place(0.34, -1, -1), place(0.36, 1, 0.15)}};
  const SiteCheck check(m, site, {}, stands);
  const Way direct = shortest_way(m, stands, nullptr), round = shortest_way(m, stands, &check);
  EXPECT_TRUE(round.not_free.empty());
  EXPECT_EQ(round.order[2], 4u);
  EXPECT_GT(round.length, direct.length);
  // Without a place above there is no free way, and the move that needs one is named.
  const std::vector<Stand> low(stands.begin(), stands.begin() + 4);
  const Way blocked = shortest_way(m, low, &check);
  ASSERT_EQ(blocked.not_free.size(), 1u);
  EXPECT_EQ(blocked.not_free[0], 1u);
}

TEST(Site, CandidatesKeepToTheSite) {
  const AnyMachine m = *machine::load("lola50");
  CalibrationOptions options;
  Site site;
  site.floor = -0.3;
  site.instrument = Vec3(3, -1, 0.5);
  site.clearance = 0.08;
  site.acceptance = units::from_deg(100);
  const auto c = geometry_candidates(m, 60, 1, Kind::point, {}, options, site);
  ASSERT_TRUE(c) << to_string(c.error());
  EXPECT_EQ(c->stands.size(), 60u);
  std::size_t left_out = 0;
  for (const std::size_t n : c->left_out) left_out += n;
  EXPECT_EQ(c->drawn, 60 + left_out);
  EXPECT_GT(left_out, 20u);
  const Vec3 eye = *site.instrument;
  for (const Stand& stand : c->stands) {
    EXPECT_GE(stand.X_MT.p.z(), *site.floor + site.clearance);
    const Vec3 to_eye = (eye - stand.X_MT.p).normalized();
    EXPECT_GE(stand.X_MT.R.col(2).dot(to_eye), std::cos(site.acceptance) - 1e-12);
  }
  site.floor = 5;
  EXPECT_EQ(geometry_candidates(m, 60, 1, Kind::point, {}, options, site).error().id, "CA123");
}

// Which lost pose costs most, by brute force.
TEST(Site, TheWorstLoss) {
  const AnyMachine m = *machine::load("lola50");
  const Candidates c = *geometry_candidates(m, 60, 2, Kind::point, {}, {});
  const std::vector<std::size_t> chosen = *choose(c.equations, 12, Criterion::determinant);
  const LostPose worst = worst_loss(c.equations, chosen, c.equations);
  std::vector<Eigen::MatrixXd> all;
  for (const std::size_t i : chosen) all.push_back(c.equations[i]);
  for (std::size_t lost = 0; lost < chosen.size(); ++lost) {
    std::vector<Eigen::MatrixXd> rest = all;
    rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(lost));
    const double reading = uncertainty(rest, c.equations).reading;
    EXPECT_LE(reading, worst.left.reading);
    EXPECT_GE(reading, uncertainty(all, c.equations).reading);
    if (lost == worst.lost) {
      EXPECT_DOUBLE_EQ(reading, worst.left.reading);
    }
  }
}

}  // namespace
}  // namespace polypod::calibration
