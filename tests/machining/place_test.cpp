// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The best place against predictions that were made one by one, and the nearest place against a search by hand.
#include "polypod/machining/place.hpp"

#include <random>

#include "examples.hpp"
#include "polypod/core/units.hpp"
#include "polypod/machining/check.hpp"

namespace polypod {
namespace {

using machining::PlaceFit;
using machining::PlaceOptions;
using machining::PlaceResult;
using machining::Placing;
using testing::Example;
using testing::load_example;
using units::from_deg;
using units::from_mm;

machine::JointRange mm(double low, double high) {
  return {from_mm(low), from_mm(high)};
}

PlaceResult best(const Example& e, const PlaceOptions& options) {
  return testing::unwrap(machining::best_place(e.job, e.program, e.interpretation, options));
}

/// The largest normal error of `predict` there; negative where the program does not fit.
double predicted(const Example& e, const Placing& at) {
  const machining::Job moved = machining::placed_at(e.job, at);
  const auto p = machining::predict(moved, e.program, e.interpretation);
  return p ? std::max(std::abs(p->normal.min), std::abs(p->normal.max)) : -1;
}

PlaceOptions small_box() {
  PlaceOptions options;
  options.box = {mm(-300, 300), mm(-1450, -1150), mm(0, 0)};
  options.turns = machine::JointRange{0, from_deg(90)};
  options.resolution = 4;
  options.rotations = 3;
  options.judged = 3;
  return options;
}

TEST(Place, GivesWhatPredictGivesThere) {
  const Example e = load_example("slavkovic_square");
  const PlaceResult r = best(e, small_box());
  ASSERT_TRUE(r.best && r.start_error);
  EXPECT_DOUBLE_EQ(r.best->error, predicted(e, r.best->at));
  EXPECT_DOUBLE_EQ(*r.start_error, predicted(e, machining::placing_of(e.job)));
  for (const machining::JudgedPlace& j : r.judged) EXPECT_DOUBLE_EQ(j.error, predicted(e, j.at));
  // The square of SLAV 6 in the middle of the workspace: 273 um and more across the sides along x.
  EXPECT_NEAR(*r.start_error, 273e-6, 40e-6);
  EXPECT_LT(r.best->error, 0.9 * *r.start_error);
}

TEST(Place, NoPlaceOfAGridIsBetter) {
  const Example e = load_example("slavkovic_square");
  PlaceOptions options = small_box();
  options.resolution = 7;
  options.rotations = 7;
  options.judged = 8;
  const PlaceResult r = best(e, options);
  ASSERT_TRUE(r.best);
  // Estimates rank places, and are off by some per cent: of two that are nearly as good the worse one may be found.
  constexpr double kRanked = 0.01;
  int judged = 0;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      for (int k = 0; k < 3; ++k) {
        const Placing at{{from_mm(-300 + 300 * i), from_mm(-1450 + 150 * j), 0}, from_deg(45 * k)};
        const double error = predicted(e, at);
        if (error < 0) continue;
        ++judged;
        EXPECT_GE(error, (1 - kRanked) * r.best->error) << i << j << k;
      }
  EXPECT_GT(judged, 10);
}

TEST(Place, NoPlaceOfAGridIsNearerInSpace) {
  const Example e = load_example("slavkovic_square");
  PlaceOptions options = small_box();
  options.by = machining::PlaceBy::distance;
  const PlaceResult r = best(e, options);
  ASSERT_TRUE(r.best);
  constexpr double kRanked = 0.02;
  for (int i = 0; i < 3; ++i)
    for (int k = 0; k < 3; ++k) {
      const Placing at{{from_mm(-300 + 300 * i), from_mm(-1300), 0}, from_deg(45 * k)};
      const auto p = machining::predict(machining::placed_at(e.job, at), e.program, e.interpretation);
      if (!p) continue;
      EXPECT_GE(p->largest_distance, (1 - kRanked) * r.best->distance) << i << k;
    }
  for (const machining::JudgedPlace& j : r.judged) EXPECT_NEAR(j.distance_estimate, j.distance, 0.1 * j.distance);
}

TEST(Place, EstimatesAreNearToPredict) {
  const Example e = load_example("slavkovic_square");
  const PlaceResult r = best(e, small_box());
  // The force of a deflected cutter changes by some per cent from place to place, which an estimate leaves out.
  for (const machining::JudgedPlace& j : r.judged) EXPECT_NEAR(j.estimate, j.error, 0.08 * j.error);
}

// The margin of a place against the ranges that `check` finds there, which looks at the program every millimetre.
TEST(Place, MarginsAreThoseOfTheRangesThatCheckFinds) {
  const Example e = load_example("slavkovic_square");
  const PlaceResult r = best(e, small_box());
  constexpr double kBetweenPoints = 2e-3;  // of a range: the margin looks at some 200 points, 5 mm apart
  int compared = 0;
  double least = 1, most = 0;
  for (const machining::PlacePoint& p : r.map.points) {
    if (p.fit != PlaceFit::fits) continue;
    const auto checked = testing::unwrap(machining::check(e.job.machine, p.at.pose(), e.program, e.interpretation));
    if (!checked.problems.empty()) continue;
    double want = 0.5;
    for (int i = 0; i < kinematics::joint_count(e.job.machine); ++i) {
      const machine::JointRange has = checked.joints[static_cast<std::size_t>(i)];
      const machine::JointRange may = kinematics::joint_range(e.job.machine, i);
      want = std::min({want, (has.min - may.min) / (may.max - may.min), (may.max - has.max) / (may.max - may.min)});
    }
    EXPECT_NEAR(p.margin, want, kBetweenPoints);
    least = std::min(least, want);
    most = std::max(most, want);
    ++compared;
  }
  EXPECT_GT(compared, 4);
  EXPECT_GT(most - least, 0.02);
}

TEST(Place, SameWithOneThread) {
  const Example e = load_example("slavkovic_square");
  PlaceOptions options = small_box();
  const PlaceResult many = best(e, options);
  options.threads = 1;
  const PlaceResult one = best(e, options);
  ASSERT_TRUE(many.best && one.best);
  EXPECT_EQ(many.best->at.origin, one.best->at.origin);
  EXPECT_EQ(many.best->at.turn, one.best->at.turn);
  EXPECT_EQ(many.best->error, one.best->error);
  ASSERT_EQ(many.map.points.size(), one.map.points.size());
  for (std::size_t i = 0; i < one.map.points.size(); ++i) EXPECT_EQ(many.map.points[i].error, one.map.points[i].error);
}

TEST(Place, StartOutOfReachHasNoErrorButAPlaceIsFound) {
  Example e = load_example("slavkovic_square");
  e.job.X_MW.p.y() = from_mm(-2600);
  PlaceOptions options;
  options.resolution = 4;
  options.rotations = 2;
  options.judged = 2;
  const PlaceResult r = best(e, options);
  EXPECT_NE(r.start_fit, PlaceFit::fits);
  EXPECT_FALSE(r.start_error);
  ASSERT_TRUE(r.best);
  const auto checked = testing::unwrap(machining::check(e.job.machine, r.best->at.pose(), e.program, e.interpretation));
  EXPECT_TRUE(checked.ok);
}

TEST(Place, NothingFitsInABoxOutOfReach) {
  const Example e = load_example("slavkovic_square");
  PlaceOptions options = small_box();
  options.box = {mm(0, 100), mm(-4000, -3900), mm(0, 0)};
  const PlaceResult r = best(e, options);
  EXPECT_EQ(r.fitting, 0u);
  EXPECT_FALSE(r.best);  // the start fits, but does not lie in the box
  EXPECT_TRUE(r.start_error);
}

/// No place is an answer where joints are too fast, that of the forces included; and none beside the box.
TEST(Place, AnAnswerPassesTheWholeCheckAndLiesInTheBox) {
  Example e = load_example("slavkovic_square");
  e.job.joint_speeds.assign(5, from_deg(0.01));
  const PlaceResult none = best(e, small_box());
  EXPECT_FALSE(none.best);
  EXPECT_EQ(none.start_fit, PlaceFit::speed);
  EXPECT_EQ(none.failed_by, PlaceFit::speed);
  EXPECT_GT(none.failed, 0u);
  e.job.joint_speeds.clear();
  PlaceOptions beside = small_box();
  beside.box[0] = mm(250, 300);  // the start is at 0
  beside.turns = machine::JointRange{0, 0};
  const PlaceResult r = best(e, beside);
  ASSERT_TRUE(r.best && r.start_error);
  EXPECT_GE(r.best->at.origin.x(), from_mm(250) - 1e-9);
}

TEST(Place, RefusesAReversedBox) {
  const Example e = load_example("slavkovic_square");
  PlaceOptions options = small_box();
  options.box[1] = mm(100, -100);
  const auto r = machining::best_place(e.job, e.program, e.interpretation, options);
  ASSERT_FALSE(r);
  EXPECT_EQ(r.error().id, "MC400");
}

TEST(Place, CanBeCancelled) {
  const Example e = load_example("slavkovic_square");
  PlaceOptions options = small_box();
  options.progress = [](double, const char* what) { return std::string(what) != "looking at places"; };
  const auto r = machining::best_place(e.job, e.program, e.interpretation, options);
  ASSERT_FALSE(r);
  EXPECT_EQ(r.error().id, "MC299");
}

TEST(NearestPlaces, SmallestShiftAgainstManyDirections) {
  Example e = load_example("slavkovic_square");
  e.job.X_MW.p = {from_mm(900), from_mm(-1700), from_mm(-50)};
  machining::CheckOptions coarse;
  coarse.step = 10e-3;
  coarse.stop_at_first = true;
  const auto fits = [&](const Vec3& p) {
    const Pose X{Mat3::Identity(), p};
    return testing::unwrap(machining::check(e.job.machine, X, e.program, e.interpretation, coarse)).ok;
  };
  ASSERT_FALSE(fits(e.job.X_MW.p));
  const auto found = testing::unwrap(machining::nearest_places(e.job.machine, e.job.X_MW, e.program, e.interpretation));
  ASSERT_TRUE(found.by_shift);
  const Vec3 by = found.by_shift->origin - e.job.X_MW.p;
  EXPECT_TRUE(testing::unwrap(machining::check(e.job.machine, found.by_shift->pose(), e.program, e.interpretation)).ok);
  EXPECT_FALSE(fits(e.job.X_MW.p + by * (1 - from_mm(1) / by.norm()))) << "a millimetre less would do";
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  constexpr double kSlack = 0.3e-3;  // the search rounds to 0.1 mm an axis
  for (int i = 0; i < 1500; ++i) {
    const Vec3 d = Vec3(normal(random), normal(random), normal(random)).normalized();
    EXPECT_FALSE(fits(e.job.X_MW.p + d * (by.norm() - kSlack))) << d.transpose();
  }
}

TEST(NearestPlaces, SmallestRotation) {
  // A long part that fits along x, but not along y.
  Example e = testing::with_program(
      "slavkovic_square", "G21 G90 G17 G54 G94\nS8000 M3\nG0 X-600 Y0\nG0 Z5\nG1 Z-2 F1000\nG1 X600\nG0 Z5\nM2\n");
  e.job.X_MW.p = {0, from_mm(-1300), 0};
  e.job.X_MW.R = rotation_z(from_deg(90));
  const auto ok = [&](double deg) {
    const Pose X{rotation_z(from_deg(deg)), e.job.X_MW.p};
    return testing::unwrap(machining::check(e.job.machine, X, e.program, e.interpretation)).ok;
  };
  ASSERT_FALSE(ok(90));
  const auto found = testing::unwrap(machining::nearest_places(e.job.machine, e.job.X_MW, e.program, e.interpretation));
  ASSERT_TRUE(found.by_turn);
  const double turn = units::to_deg(found.by_turn->turn);
  EXPECT_TRUE(ok(turn));
  const double by = std::abs(turn - 90);
  for (double less = 0; less < by - 0.15; less += 0.5) {
    EXPECT_FALSE(ok(90 + less)) << less;
    EXPECT_FALSE(ok(90 - less)) << less;
  }
}

}  // namespace
}  // namespace polypod
