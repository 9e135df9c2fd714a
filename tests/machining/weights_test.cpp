// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The weight of the machine in the path of its tool: a closed form of three slides, the twist at each point, and a
// correction that holds where its own pass counts the weight.
#include "polypod/machining/weights.hpp"

#include <gtest/gtest.h>

#include <random>

#include "examples.hpp"
#include "machines.hpp"
#include "polypod/core/units.hpp"
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

TEST(Weights, AnOriginOutOfReachIsNamed) {
  testing::Example e = testing::load_example("slavkovic_square");
  e.job.X_MW.p.y() -= 5;
  const auto weight = WeightDeflection::of(e.job, masses_of(e.job));
  ASSERT_FALSE(weight);
  EXPECT_EQ(weight.error().id, "MC212");
}

}  // namespace
}  // namespace polypod::machining
