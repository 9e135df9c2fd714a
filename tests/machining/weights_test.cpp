// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The weight of the machine in the path of its tool: a closed form of three slides, the twist at each point, and a
// correction that holds where its own pass counts the weight.
#include "polypod/machining/weights.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <random>

#include "examples.hpp"
#include "machines.hpp"
#include "polypod/core/units.hpp"
#include "polypod/machining/place.hpp"
#include "polypod/machining/tilted.hpp"
#include "slides.hpp"

namespace polypod::machining {
namespace {

using testing::unwrap;

std::shared_ptr<const motion::Dynamics> masses_of(const Job& job) {
  const auto read =
      unwrap(motion::read_dynamics(testing::example_path("slavkovic_square", "masses.toml"), job.machine));
  return std::make_shared<motion::Dynamics>(*read);
}

/// A slide deflects alike wherever it stands, so that nothing is left of its weight but what is in the offset.
TEST(Weights, OfSlidesAreInTheOffset) {
  testing::Example e = testing::load_example("slavkovic_square");
  e.job.machine = machine::AnyMachine(test::arm_of(kSlides));
  e.job.X_MW.p.setZero();
  const auto masses = std::make_shared<motion::Dynamics>(masses_of_slides());
  WeightDeflection weight = unwrap(WeightDeflection::of(e.job, masses));
  const double g = 9.80665;
  EXPECT_LT((weight.at_origin() - Vec3(0, 0, -kMassZ * g / kStiffnessZ)).norm(), 1e-15);
  EXPECT_LT(weight.at(Vec3(0.31, -0.2, 0.07))->norm(), 1e-15);
}

TEST(Weights, AreThoseOfThePointWithinTheCells) {
  const testing::Example e = testing::load_example("slavkovic_square");
  const auto masses = masses_of(e.job);
  WeightDeflection weight = unwrap(WeightDeflection::of(e.job, masses));
  const Mat3 R = cutting_orientation(e.job);
  statics::Probe probe(e.job.machine, R);
  const auto whole = [&](const Vec3& p_W) {
    const Vec3 p = e.job.X_MW * p_W;
    Mat3 C;
    EXPECT_TRUE(probe.at(p, C));
    const Pose X = kinematics::forward(e.job.machine, probe.joints()).poses.front();
    return Vec3(e.job.X_MW.R.transpose() * motion::weight_twist(e.job.machine, *masses, X, probe.joints()).head<3>());
  };
  const Vec3 origin = whole(Vec3::Zero());
  EXPECT_LT((weight.at_origin() - origin).norm(), 1e-12);
  std::mt19937 random(7);
  std::uniform_real_distribution<double> side(-0.12, 0.12);
  double largest = 0;
  for (int k = 0; k < 200; ++k) {
    const Vec3 p(side(random), side(random), 0.1 * side(random));
    const Vec3 want = whole(p) - origin;
    largest = std::max(largest, want.norm());
    EXPECT_LT((*weight.at(p) - want).norm(), 1e-5 * origin.norm());
  }
  EXPECT_GT(largest, 20e-6) << "an arm deflects differently from place to place";
}

/// Where the force counts at the commanded point, what the tool is off by is C F and the weight, and a level cut is as
/// much deeper as the weight pulls the tool down.
TEST(Weights, AddToTheDeflectionAndToTheDepth) {
  testing::Example e = testing::load_example("slavkovic_square");
  e.job.weights = masses_of(e.job);
  PredictOptions options;
  options.keep_samples = true;
  options.bend = Bend::at_rest;
  const Prediction with = testing::predict(e, options);
  WeightDeflection weight = unwrap(WeightDeflection::of(e.job, e.job.weights));
  statics::Probe probe(e.job.machine, cutting_orientation(e.job));
  const double programmed = e.job.stock.top() - (-2e-3);
  double largest = 0, shallow = 1, deep = 0;
  for (const Sample& s : with.samples) {
    if (!s.cutting) continue;
    Mat3 C;
    ASSERT_TRUE(probe.at(e.job.X_MW * s.command, C));
    const Vec3 by_weight = *weight.at(s.command), by_force = C * s.force;
    largest = std::max(largest, by_weight.norm());
    ASSERT_LT((s.deflection - by_weight - by_force).norm(), 1e-6);  // C is that a millimetre beside
    if (s.s < 0.03 || s.s > 0.22) continue;  // where the cut of the move before is, or the edge of the part
    const double depth = static_cast<double>(s.depth);
    ASSERT_LT(std::abs(depth - (programmed - by_weight.z())), 60e-6) << s.s;  // of the way ahead that is looked at
    shallow = std::min(shallow, depth);
    deep = std::max(deep, depth);
  }
  EXPECT_GT(largest, 500e-6);
  EXPECT_GT(deep - shallow, 1e-3);
  const WeightOnCuts size = unwrap(weight_on_cuts(e.job, with, e.job.weights));
  EXPECT_NEAR(size.largest, largest, 0.02 * largest);
  EXPECT_NEAR(size.at_origin, weight.at_origin().norm(), 1e-15);
}

TEST(Weights, AreCorrectedWithTheForces) {
  testing::Example e = testing::load_example("slavkovic_square");
  const Correction forces_alone = testing::correct(e);
  ASSERT_TRUE(forces_alone.within_tolerance);
  e.job.weights = masses_of(e.job);
  const Correction both = testing::correct(e);
  testing::expect_in_tube(e, both);
}

/// The square's job with a block and another program, the weight counted.
testing::Example with_weight(const std::string& moves) {
  testing::Example e = testing::with_program("slavkovic_square",
                                             "G17 G21 G40 G49 G80 G90 G94\nG54\nT1 M6\nS8000 M3\n" + moves + "M30\n");
  e.job.stock = unwrap(cutting::Stock::block(Vec3(-0.125, -0.125, -0.02), Vec3(0.125, 0.125, 0), 0.5e-3));
  e.job.material.end = cutting::EndCoefficients{};
  e.job.material.end->ktc = e.job.material.end->kac = 100e6;
  e.job.weights = masses_of(e.job);
  return e;
}
/// The lowest and the highest of what stands in a box of the plane, m.
machine::JointRange heights(const cutting::Stock& stock, const Eigen::AlignedBox2d& box) {
  machine::JointRange out{1, -1};
  for (int i = 0; i < stock.columns(); ++i)
    for (int j = 0; j < stock.rows(); ++j) {
      if (!box.contains(
              Eigen::Vector2d(stock.x_min() + (i + 0.5) * stock.cell(), stock.y_min() + (j + 0.5) * stock.cell())))
        continue;
      out.min = std::min<double>(out.min, stock.height(i, j));
      out.max = std::max<double>(out.max, stock.height(i, j));
    }
  return out;
}
Correction corrected_with_stock(const testing::Example& e) {
  CorrectOptions options;
  options.keep_stock = true;
  return testing::correct(e, options);
}
Eigen::AlignedBox2d about(double x, double y, double half) {
  return {Eigen::Vector2d(x - half, y - half), Eigen::Vector2d(x + half, y + half)};
}

/// When the load of the cut goes, the weight stays: before it retracts the tool does not go back to the programmed
/// point, where it would stand 387 um deeper.
TEST(Weights, ARetractWithinTheStockLeavesNoMark) {
  const testing::Example e = with_weight("G0 X-135 Y-60 Z10\nG0 Z-2\nG1 X-100 F800\nG0 Z10\n");
  const Correction c = corrected_with_stock(e);
  EXPECT_TRUE(c.within_tolerance) << c.reason;
  const machine::JointRange floor = heights(c.stock_left, about(-0.1, -0.06, 3e-3));
  EXPECT_NEAR(floor.min, -2e-3, e.job.tolerance);
}

/// A hole has the depth that was programmed. Without a correction the answer says by how much it has not.
TEST(Weights, PlungesEndWhereTheyShould) {
  for (const auto& [x, y] : {std::pair{0.11, 0.11}, {0.0, -0.1}}) {
    const testing::Example e = with_weight(
        fmt::format("G0 X{0} Y{1} Z10\nG0 Z3\nG1 Z-2 F200\nG4 P2\nG0 Z10\n", units::to_mm(x), units::to_mm(y)));
    WeightDeflection weight = unwrap(WeightDeflection::of(e.job, e.job.weights));
    const double off = weight.at(Vec3(x, y, -2e-3))->norm();
    EXPECT_GT(off, 3 * e.job.tolerance);
    for (const double step : {0.1e-3, 0.5e-3}) {
      PredictOptions options;
      options.step = step;
      const Prediction before = testing::predict(e, options);
      EXPECT_NEAR(before.largest_distance, off, 0.02 * off) << step;
      EXPECT_FALSE(before.within(e.job));
      for (const Plunge& plunge : before.plunges) EXPECT_LT(plunge.held_back, 0.2 * off);
    }
    const Correction c = corrected_with_stock(e);
    EXPECT_TRUE(c.within_tolerance) << c.reason;
    EXPECT_NEAR(heights(c.stock_left, about(x, y, 2e-3)).max, -2e-3, e.job.tolerance);
    EXPECT_NEAR(heights(c.stock_left, about(x, y, 2e-3)).min, -2e-3, e.job.tolerance);
  }
}

/// The weight lifts the tool off a cut of 0.2 mm: what it misses is as far off as it is, and a correction takes it.
TEST(Weights, ACutThatIsMissedIsNoYes) {
  const testing::Example e =
      with_weight("G0 X-135 Y0 Z10\nG0 Z-0.2\nG1 X20 F800\nG0 Z10\nG0 X-135 Y100\nG0 Z-0.2\nG1 X135\nG0 Z10\n");
  WeightDeflection weight = unwrap(WeightDeflection::of(e.job, e.job.weights));
  const Prediction before = testing::predict(e);
  EXPECT_FALSE(before.within(e.job));
  ASSERT_EQ(before.moves.size(), 2U);
  EXPECT_GT(before.moves[1].largest_distance, weight.at(Vec3(0, 0.1, -0.2e-3))->norm() - 1e-6);
  const Correction c = corrected_with_stock(e);
  EXPECT_TRUE(c.within_tolerance) << c.reason;
  EXPECT_NEAR(heights(c.stock_left, about(0, 0.1, 3e-3)).max, -0.2e-3, e.job.tolerance);
  // Alone it is judged as well, and not refused as a program that cuts nothing.
  const testing::Example alone = with_weight("G0 X-135 Y100 Z10\nG0 Z-0.2\nG1 X135 F800\nG0 Z10\n");
  EXPECT_FALSE(testing::predict(alone).within(alone.job));
}

/// A second pass along a slot cuts nothing where the weight is corrected, and stays as deep as the first.
TEST(Weights, ASecondPassKeepsTheDepth) {
  const testing::Example e = with_weight("G0 X-135 Y-60 Z10\nG0 Z-2\nG1 X0 F800\nG1 X-100\nG1 X-10\nG0 Z10\n");
  const Correction c = corrected_with_stock(e);
  EXPECT_TRUE(c.within_tolerance) << c.reason;
  const machine::JointRange floor =
      heights(c.stock_left, {Eigen::Vector2d(-0.12, -0.062), Eigen::Vector2d(-0.01, -0.058)});
  EXPECT_NEAR(floor.min, -2e-3, e.job.tolerance);
  EXPECT_NEAR(floor.max, -2e-3, e.job.tolerance);
}

/// Places are ranked by estimates that know the weight: each is near what the prediction with the weight gives there.
TEST(Weights, RankPlaces) {
  testing::Example e = testing::load_example("slavkovic_square");
  e.job.weights = masses_of(e.job);
  PlaceOptions options;
  options.box = {machine::JointRange{-0.2, 0.2}, machine::JointRange{-1.4, -1.2}, machine::JointRange{0, 0}};
  options.turns = machine::JointRange{0, 0.8};
  options.resolution = 3;
  options.rotations = 2;
  options.judged = 2;
  const PlaceResult r = unwrap(best_place(e.job, e.program, e.interpretation, options));
  ASSERT_TRUE(r.best && r.start_error);
  const Prediction at_start = unwrap(predict(e.job, e.program, e.interpretation));
  EXPECT_NEAR(*r.start_error, largest_normal_error(at_start), 1e-12);
  EXPECT_LT(r.best->error, *r.start_error);
  constexpr double kEstimate = 0.15;  // forces are those of the start, of the moves with the largest deflection
  for (const JudgedPlace& judged : r.judged) EXPECT_NEAR(judged.estimate, judged.error, kEstimate * judged.error);
}

TEST(Weights, AnOriginOutOfReachIsNamed) {
  testing::Example e = testing::load_example("slavkovic_square");
  e.job.X_MW.p.y() -= 5;
  const auto weight = WeightDeflection::of(e.job, masses_of(e.job));
  ASSERT_FALSE(weight);
  EXPECT_EQ(weight.error().id, "MC212");
}

}  // namespace
}  // namespace polypod::machining
