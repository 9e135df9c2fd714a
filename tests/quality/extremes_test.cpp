// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Largest and least values between the points of a grid; elements that count twice; bars of equal elements.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "machines.hpp"
#include "polypod/core/random.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/quality/survey.hpp"

namespace polypod::quality {
namespace {

using test::load;

SurveyOptions boxed(const Vec3& low_mm, const Vec3& high_mm, int resolution, double tilt_deg) {
  SurveyOptions options;
  options.workspace.directions.tilt = units::from_deg(tilt_deg);
  options.resolution = resolution;
  options.box = {1e-3 * low_mm, 1e-3 * high_mm};
  return options;
}

struct Looked {
  Survey survey;
  ErrorField errors;
  DexterityField dexterity;
};
Looked look(const AnyMachine& m, const SurveyOptions& options) {
  const auto s = survey(m, options);
  const auto sizes = *sized(m, {{"all", 0.01}}, true);
  return {*s, *tolerance_field(m, *s, options, sizes), *dexterity_field(m, *s, options)};
}

// Where a coarse grid and its refinement look, a grid ten times finer must not find much more, and both stay in the
// box.
constexpr double kMissed = 2e-3;  // as a share: the refinement ends at 1/50 of the coarse spacing

TEST(Extremes, AreThoseOfAGridTenTimesFiner) {
  const AnyMachine m = load("hexapod-strut");
  const Vec3 low(-9, -7, 58), high(9, 11, 76);
  const SurveyOptions coarse = boxed(low, high, 4, 10), fine = boxed(low, high, 31, 10);
  const Looked few = look(m, coarse), many = look(m, fine);
  struct Case {
    const Quantity &few, &many;
    const Anywhere& anywhere;
    std::size_t number;
  };
  for (const Case& c : {Case{few.errors.position, many.errors.position, few.errors.anywhere, 0},
                        {few.errors.orientation, many.errors.orientation, few.errors.anywhere, 1},
                        {few.dexterity.condition, many.dexterity.condition, few.dexterity.anywhere, 0},
                        {few.dexterity.sigma_min, many.dexterity.sigma_min, few.dexterity.anywhere, 1},
                        {few.dexterity.determinant, many.dexterity.determinant, few.dexterity.anywhere, 2}}) {
    const Statistics seen = statistics_seen(m, few.survey, coarse, c.few, c.anywhere, c.number);
    const Statistics grid = statistics(few.survey, c.few.mean), dense = statistics(many.survey, c.many.mean);
    EXPECT_GE(seen.max, grid.max);
    EXPECT_LE(seen.min, grid.min);
    EXPECT_GE(seen.max, dense.max * (1 - kMissed)) << c.number;
    EXPECT_LE(seen.min, dense.min * (1 + kMissed)) << c.number;
    EXPECT_NEAR(c.anywhere.at_point(seen.max_at).mean[c.number] / seen.max, 1, 1e-12);
    EXPECT_NEAR(c.anywhere.at_point(seen.min_at).mean[c.number] / seen.min, 1, 1e-12);
    for (const Vec3& at : {seen.max_at, seen.min_at}) {
      EXPECT_GE((at - 1e-3 * low).minCoeff(), -1e-15);
      EXPECT_GE((1e-3 * high - at).minCoeff(), -1e-15);
    }
    EXPECT_EQ(seen.mean, grid.mean);
  }
}

TEST(Extremes, LieBetweenThePointsOfAnArmsGrid) {
  // The condition number of the arm over a thin box has its least inside, which few points miss.
  const AnyMachine m = load("lola50");
  const Vec3 low(-150, -1450, 0), high(150, -1150, 1);
  const SurveyOptions coarse = boxed(low, high, 3, 0), fine = boxed(low, high, 41, 0);
  const Looked few = look(m, coarse), many = look(m, fine);
  const Quantity& q = few.dexterity.determinant;
  const Statistics seen = statistics_seen(m, few.survey, coarse, q, few.dexterity.anywhere, 2);
  const Statistics dense = statistics(many.survey, many.dexterity.determinant.mean);
  EXPECT_GE(seen.max, dense.max * (1 - kMissed));
  EXPECT_LE(seen.min, dense.min * (1 + kMissed));
}

TEST(Extremes, WorstPosesKeepTheWorkspaceAndTheDirections) {
  const AnyMachine m = load("hexapod-strut");
  SurveyOptions options;
  options.workspace.directions.tilt = units::from_deg(20);
  options.resolution = 9;
  const Looked f = look(m, options);
  const Extreme grid = worst_of(f.survey, f.errors.position);
  const Extreme seen = worst_seen(m, f.survey, options, f.errors.position, f.errors.anywhere, 0);
  EXPECT_GT(seen.value, grid.value * 1.001);
  const auto q = joints_at(m, seen.X_MT);
  ASSERT_TRUE(q);
  EXPECT_NEAR(worst_case(m, seen.X_MT, *q, *sized(m, {{"all", 0.01}}, true))->position / seen.value, 1, 1e-12);
  EXPECT_TRUE(workspace::reaches_samples(m, options.workspace, f.survey.orientations, seen.X_MT.p));
  EXPECT_LE(rotation_vector(seen.X_MT.R).norm(), units::from_deg(20) * (1 + 1e-12));
  const Extreme least = worst_seen(m, f.survey, options, f.dexterity.sigma_min, f.dexterity.anywhere, 1, -1);
  EXPECT_LE(least.value, *std::min_element(f.dexterity.sigma_min.worst.begin(), f.dexterity.sigma_min.worst.end()));
  EXPECT_NEAR(kinematics::dexterity(m, least.X_MT, *joints_at(m, least.X_MT)).sigma_min / least.value, 1, 1e-12);
}

TEST(Extremes, ReachTheTipsOfADelta) {
  // The largest condition number stands at the lower tip of the workspace, between the points of the grid. Against it:
  // random poses of the box in which the workspace lies, judged by the inverse kinematics alone.
  const AnyMachine m = test::flat_delta();
  const SurveyOptions options;
  const Looked f = look(m, options);
  const auto largest = [&](const std::function<double(const Pose&, const JointVector&)>& value, double sign) {
    Random random(7);
    double most = -std::numeric_limits<double>::infinity();
    constexpr int kPoses = 100'000;
    for (int i = 0; i < kPoses; ++i) {
      const Pose X{Mat3::Identity(),
                   Vec3(random.uniform(-0.7, 0.7), random.uniform(-0.7, 0.7), random.uniform(0.35, 1.14))};
      const auto found = kinematics::inverse(m, X);
      if (const auto* s = found.reachable()) most = std::max(most, sign * value(X, s->joints));
    }
    return sign * most;
  };
  const auto condition = [&](const Pose& X, const JointVector& q) { return kinematics::dexterity(m, X, q).condition; };
  const auto sigma = [&](const Pose& X, const JointVector& q) { return kinematics::dexterity(m, X, q).sigma_min; };
  const Extreme worst = worst_seen(m, f.survey, options, f.dexterity.condition, f.dexterity.anywhere, 0);
  EXPECT_GE(worst.value, largest(condition, 1));
  constexpr double kFineGrid = 7.3589;  // what a grid of 80 points a side sees
  EXPECT_GE(worst.value, kFineGrid);
  EXPECT_NEAR(condition(worst.X_MT, *joints_at(m, worst.X_MT)) / worst.value, 1, 1e-12);
  EXPECT_TRUE(kinematics::inverse(m, worst.X_MT).reachable());
  const Extreme least = worst_seen(m, f.survey, options, f.dexterity.sigma_min, f.dexterity.anywhere, 1, -1);
  EXPECT_LE(least.value, largest(sigma, -1));
}

TEST(Extremes, OfOneDirectionAreOneQuantity) {
  const AnyMachine delta = test::flat_delta(), hexapod = load("hexapod-strut");
  SurveyOptions options;
  options.resolution = 12;
  for (const AnyMachine& m : {delta, hexapod}) {
    const Looked f = look(m, options);
    const auto& [condition, sigma, determinant, length, anywhere] = f.dexterity;
    const Statistics means = statistics_seen(m, f.survey, options, condition, anywhere, 0);
    const Extreme worst = worst_seen(m, f.survey, options, condition, anywhere, 0);
    EXPECT_EQ(means.max, worst.value);
    EXPECT_EQ(means.max_at, worst.X_MT.p);
    EXPECT_EQ(statistics_seen(m, f.survey, options, sigma, anywhere, 1).min,
              worst_seen(m, f.survey, options, sigma, anywhere, 1, -1).value);
    EXPECT_EQ(statistics_seen(m, f.survey, options, f.errors.position, f.errors.anywhere, 0).max,
              worst_seen(m, f.survey, options, f.errors.position, f.errors.anywhere, 0).value);
  }
}

TEST(Extremes, OfRangesStayInTheRanges) {
  const AnyMachine m = load("hexapod-strut");
  SurveyOptions options = boxed({-3, -3, 66}, {3, 3, 72}, 3, 0);
  options.workspace.directions.tilt = 0;
  options.workspace.directions.a_range = std::array<double, 2>{units::from_deg(-4), units::from_deg(9)};
  options.workspace.directions.b_range = std::array<double, 2>{units::from_deg(2), units::from_deg(6)};
  const Looked f = look(m, options);
  for (const double sign : {1.0, -1.0}) {
    const Extreme seen = worst_seen(m, f.survey, options, f.dexterity.condition, f.dexterity.anywhere, 0, sign);
    const Vec3 abc = angles_abc(seen.X_MT.R) / units::kRadPerDeg;
    constexpr double kRounding = 1e-9;
    EXPECT_GE(abc.x(), -4 - kRounding);
    EXPECT_LE(abc.x(), 9 + kRounding);
    EXPECT_GE(abc.y(), 2 - kRounding);
    EXPECT_LE(abc.y(), 6 + kRounding);
    EXPECT_NEAR(abc.z(), 0, kRounding);
  }
}

TEST(Extremes, OfNoFiniteValueHaveNoMean) {
  const AnyMachine m = load("hexapod-strut");
  const auto s = survey(m, boxed({-1, -1, 66}, {1, 1, 68}, 2, 0));
  const std::vector<double> values(s->inside.size(), std::numeric_limits<double>::infinity());
  const Statistics none = statistics(*s, values);
  EXPECT_TRUE(std::isnan(none.mean) && std::isnan(none.stddev));
  EXPECT_TRUE(std::isinf(none.max));
}

TEST(OneElementAJoint, LeavesOutAttachmentsWhoseJointCounts) {
  const AnyMachine m = load("hexapod-strut");
  const auto both = *sized(m, {{"all", 0.01}}, true);
  const auto once = one_element_a_joint(m, both);
  ASSERT_TRUE(once);
  const auto named = *sized(m, {{"leg.length", 0.01}, {"base.joint", 0.01}, {"platform.joint", 0.01}}, true);
  ASSERT_EQ(once->size(), named.size());
  for (std::size_t i = 0; i < named.size(); ++i) EXPECT_EQ((*once)[i].element, named[i].element);
  // An attachment acts exactly like its joint: with all joints counted once the share of the joints is halved.
  const Pose X{Mat3::Identity(), Vec3(0.003, -0.002, 0.07)};
  const auto q = *joints_at(m, X);
  const double legs = worst_case(m, X, q, *sized(m, {{"leg.length", 0.01}}, true))->position;
  const double twice = worst_case(m, X, q, both)->position, single = worst_case(m, X, q, *once)->position;
  EXPECT_LT(single, 0.6 * twice);
  EXPECT_GT(single, 0.5 * twice);
  EXPECT_NEAR(twice - single, single - legs, 0.02 * single);  // equal but for the directions of the vertices
  EXPECT_FALSE(one_element_a_joint(m, named));
  EXPECT_FALSE(one_element_a_joint(m, *sized(m, {{"base.attachment", 0.01}, {"platform.joint", 0.01}}, true)));
  const AnyMachine arm = load("lola50");
  EXPECT_FALSE(one_element_a_joint(arm, *sized(arm, {{"all", 0.01}}, true)));
}

TEST(Bars, OfEqualElementsAreOne) {
  const AnyMachine m = load("hexapod-strut");
  const Pose X{Mat3::Identity(), Vec3(0.003, -0.002, 0.07)};
  const auto sizes = *sized(m, {{"all", 0.01}}, true);
  const auto worst = worst_case(m, X, *joints_at(m, X), sizes);
  std::vector<std::pair<int, double>> values;
  for (const auto& s : worst->shares) values.emplace_back(s.element, s.position);
  const auto bars = bars_of(m, values);
  double total = 0;
  int elements = 0;
  for (const Bar& bar : bars) {
    total += bar.total();
    elements += bar.elements;
    // A joint never stands alone: its attachment has the same share.
    EXPECT_EQ(bar.name.find("base.joint") == std::string::npos, bar.name.find("base.attachment") == std::string::npos);
  }
  EXPECT_EQ(elements, 30);
  EXPECT_LE(bars.size(), 18u);
  EXPECT_NEAR(total / worst->position, 1, 1e-12);
  EXPECT_TRUE(
      std::is_sorted(bars.begin(), bars.end(), [](const Bar& a, const Bar& b) { return a.total() > b.total(); }));
  // At the middle, upright, all six legs are alike or come in pairs.
  const auto few = bars_of(m, {{0, 1.0}, {1, 1.0}, {2, 0.5}, {3, 0.0}});
  ASSERT_EQ(few.size(), 2u);
  EXPECT_EQ(few[0].name, "leg.length[1,2]");
  EXPECT_EQ(few[0].elements, 2);
}

/// Six struts of other lengths from joints that lie irregularly, moved by `by`.
AnyMachine irregular(const std::string& base, const std::string& more) {
  const auto m =
      machine::from_text("family = \"strut-hexapod\"\nbase = { joints_mm = " + base + " }\n" + more, "irregular.toml");
  EXPECT_TRUE(m) << (m ? "" : to_string(m.error()));
  return *m;
}

// Platform and base are similar: with the platform level all legs meet in a point, and what comes out is rounding.
TEST(Extremes, RoundingAtSingularPosesIsNoFigure) {
  const AnyMachine m =
      irregular("[[200,0,0],[110,150,0],[-90,170,0],[-190,30,0],[-120,-160,0],[80,-210,0]]",
                "platform = { joints_mm = [[100,0,0],[55,75,0],[-45,85,0],[-95,15,0],[-60,-80,0],[40,-105,0]] }\n"
                "leg = { length_min_mm = 200, length_max_mm = 500 }\njoint = { limit = \"none\" }\n");
  SurveyOptions options;
  options.resolution = 8;
  const Looked l = look(m, options);
  for (const double mean : l.errors.position.mean) EXPECT_FALSE(std::isfinite(mean)) << mean;
  for (const double mean : l.errors.orientation.mean) EXPECT_FALSE(std::isfinite(mean)) << mean;
  EXPECT_TRUE(std::isinf(worst_seen(m, l.survey, options, l.errors.position, l.errors.anywhere, 0).value));
}

// Its workspace reaches through the plane of the base, where it is singular: between the points of every grid.
TEST(Extremes, ASingularPoseBetweenThePointsMakesTheErrorInfinite) {
  const AnyMachine m = irregular(
      "[[196.96,34.73,0],[-68.4,187.94,0],[-128.56,153.21,0],[-128.56,-153.21,0],[-68.4,-187.94,0],[196.96,-34.73,0]]",
      "platform = { joints_mm = "
      "[[76.6,64.28,0],[17.36,98.48,0],[-93.97,34.2,0],[-93.97,-34.2,0],[17.36,-98.48,0],[76.6,-64.28,0]] }\n"
      "leg = { length_min_mm = 200, length_max_mm = 500 }\njoint = { limit = \"none\" }\n");
  SurveyOptions options;
  options.resolution = 12;
  options.box = {Vec3(-0.42, -0.42, -0.05), Vec3(0.42, 0.42, 0.17)};
  const Looked l = look(m, options);
  ASSERT_TRUE(l.survey.singular);
  const auto q = joints_at(m, *l.survey.singular);
  ASSERT_TRUE(q);
  EXPECT_LT(kinematics::dexterity(m, *l.survey.singular, *q).sigma_min, 1e-9);
  EXPECT_TRUE(std::isinf(worst_seen(m, l.survey, options, l.errors.position, l.errors.anywhere, 0).value));
  EXPECT_TRUE(std::isinf(statistics_seen(m, l.survey, options, l.errors.position, l.errors.anywhere, 0).max));
  EXPECT_LT(worst_seen(m, l.survey, options, l.dexterity.sigma_min, l.dexterity.anywhere, 1, -1).value, 1e-9);
  // Above its singular poses the same machine has figures.
  options.box = {Vec3(-0.05, -0.05, 0.3), Vec3(0.05, 0.05, 0.4)};
  const Looked above = look(m, options);
  EXPECT_FALSE(above.survey.singular);
  EXPECT_LT(worst_seen(m, above.survey, options, above.errors.position, above.errors.anywhere, 0).value, 1e-3);
}

}  // namespace
}  // namespace polypod::quality
