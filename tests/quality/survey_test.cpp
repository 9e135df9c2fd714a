// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The surveys' inner loop for six legs against the closure pose by pose; singularities; design; budget.
#include "polypod/quality/survey.hpp"

#include <gtest/gtest.h>

#include <random>
#include <set>

#include "machines.hpp"

#include "four_dexterities.hpp"
#include "joint_finder.hpp"
#include "leg_kernel.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/closure.hpp"
#include "polypod/kinematics/families.hpp"
#include "polypod/quality/budget.hpp"
#include "polypod/quality/singularity.hpp"
#include "polypod/quality/tolerance_design.hpp"
#include "polypod/workspace/task_directions.hpp"

namespace polypod::quality {
namespace {

using test::load;

SurveyOptions cone(double tilt_deg, int resolution) {
  SurveyOptions options;
  options.workspace.directions.tilt = units::from_deg(tilt_deg);
  options.resolution = resolution;
  return options;
}

TEST(Survey, SixLegsAreThoseOfTheClosure) {
  for (const char* name : {"hexapod-strut", "hexapod-slider"}) {
    const AnyMachine m = load(name);
    const SurveyOptions options = cone(15, 10);
    const auto s = survey(m, options);
    ASSERT_TRUE(s);
    const auto dexterity = dexterity_field(m, *s, options);
    const std::vector<std::pair<std::string, double>> all{{"all", 0.01}, {"joint", 0.02}};
    const auto sizes = *sized(m, all, true);
    const auto box = tolerance_field(m, *s, options, sizes);
    const auto ball = tolerance_field(m, *s, options, sizes, {Method::exact, Region::sphere});
    const auto signs = *sized(m,
                              {{"base.joint[2]", -0.02},
                               {"platform.attachment[5]", 0.03},
                               {"leg.length[4]", -0.01},
                               {"joint[3]", 0.05},
                               {"platform.joint", 0.01}},
                              false);
    const auto known = known_error_field(m, *s, options, signs);
    ASSERT_TRUE(dexterity && box && ball && known);
    constexpr double kRounding = 1e-9;
    for (std::size_t i = 0; i < s->inside.size(); i += 7) {
      double kappa = 0, sigma = 0, det = 0, p = 0, w = 0, ball_p = 0, known_p = 0, known_w = 0, worst = 0;
      for (std::size_t d = 0; d < s->orientations.size(); ++d) {
        const Pose X = pose_at(*s, i, static_cast<int>(d));
        const auto q = joints_at(m, X);
        const auto one = kinematics::dexterity(m, X, *q);
        kappa += one.condition / 49;
        sigma += one.sigma_min / 49;
        det += one.determinant / 49;
        const auto w_box = worst_case(m, X, *q, sizes);
        p += w_box->position / 49;
        w += w_box->orientation / 49;
        worst = std::max(worst, w_box->position);
        ball_p += worst_case(m, X, *q, sizes, {Method::exact, Region::sphere})->position / 49;
        const Vec6 e = known_error(m, X, *q, signs);
        known_p += e.head<3>().norm() / 49;
        known_w += e.tail<3>().norm() / 49;
      }
      EXPECT_NEAR(dexterity->condition.mean[i] / kappa, 1, kRounding) << name;
      EXPECT_NEAR(dexterity->sigma_min.mean[i] / sigma, 1, kRounding) << name;
      EXPECT_NEAR(dexterity->determinant.mean[i] / det, 1, kRounding) << name;
      EXPECT_NEAR(box->position.mean[i] / p, 1, kRounding) << name;
      EXPECT_NEAR(box->orientation.mean[i] / w, 1, kRounding) << name;
      EXPECT_NEAR(box->position.worst[i] / worst, 1, kRounding) << name;
      EXPECT_NEAR(ball->position.mean[i] / ball_p, 1, kRounding) << name;
      EXPECT_NEAR(known->position.mean[i] / known_p, 1, kRounding) << name;
      EXPECT_NEAR(known->orientation.mean[i] / known_w, 1, kRounding) << name;
      const Pose X = pose_at(*s, i, box->position.worst_direction[i]);
      EXPECT_NEAR(worst_case(m, X, *joints_at(m, X), sizes)->position / worst, 1, kRounding);
    }
  }
}

/// Poses of a machine round its home and beyond, some of them out of reach.
std::vector<Pose> poses_of(const AnyMachine& m, int count) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> part(-1, 1);
  JointVector home = JointVector::Constant(kinematics::joint_count(m), 0.3);
  if (const auto X = kinematics::home_pose(m)) home = kinematics::inverse(m, *X).solutions.at(0).joints;
  std::vector<Pose> out;
  for (int k = 0; k < count; ++k) {
    JointVector q = home;
    for (int i = 0; i < q.size(); ++i) {
      const auto range = kinematics::joint_range(m, i);
      const bool open = !(std::isfinite(range.max) && std::isfinite(range.min));
      q[i] += 0.6 * part(random) * (open ? 0.5 : range.max - range.min);
    }
    const auto found = kinematics::forward(m, q);
    if (!found.poses.empty()) out.push_back(found.poses.front());
  }
  return out;
}

TEST(Survey, JointsOfPoseAfterPoseAreTheFirstWithinTheLimits) {
  int found = 0, none = 0;
  for (const char* name : {"lola50", "kuka-kr210", "ur10e", "puma560", "delta-brno", "delta-linear", "delta-par4"}) {
    const AnyMachine m = load(name);
    const JointFinder joints = joint_finder(m);
    for (const Pose& X : poses_of(m, 300)) {
      const kinematics::InverseResult all = kinematics::inverse(m, X);
      const kinematics::Solution* first = all.reachable();
      const auto q = joints(X);
      ASSERT_EQ(q.has_value(), first != nullptr) << name;
      ++(q ? found : none);
      if (!q) continue;
      EXPECT_LT((*q - first->joints).cwiseAbs().maxCoeff(), 1e-12) << name;
    }
  }
  EXPECT_GT(found, 500);
  EXPECT_GT(none, 100);
}

TEST(Survey, DexteritiesAtOnceAreThoseOnePoseAtATime) {
  for (const char* name : {"lola50", "kuka-kr210", "delta-brno", "delta-par4", "tripod-z3", "hexapod-strut"}) {
    const AnyMachine m = load(name);
    std::vector<kinematics::RateMatrix> rates;
    for (const Pose& X : poses_of(m, 600))
      if (const auto q = joints_at(m, X); q && rates.size() < 60) rates.push_back(kinematics::rate_matrix(m, X, *q));
    ASSERT_GT(rates.size(), 9u) << name;
    // A singular one among others: the last row once more.
    rates[3].S.row(0) = rates[3].S.row(1);
    for (std::size_t at = 0; at < rates.size(); at += kLanes) {
      const std::size_t count = std::min<std::size_t>(kLanes, rates.size() - at);
      std::array<std::array<double, 3>, kLanes> values{};
      dexterities({rates.data() + at, count}, values.data());
      for (std::size_t i = 0; i < count; ++i) {
        const kinematics::Dexterity d = kinematics::dexterity(rates[at + i]);
        const double cond = std::min(d.condition, 1e4);  // squares blur by the condition's square
        EXPECT_NEAR(values[i][1], d.sigma_min, 1e-15 * cond * cond * d.sigma_min + 1e-300) << name;
        EXPECT_NEAR(values[i][2], std::abs(d.determinant), 1e-11 * std::abs(d.determinant) + 1e-18) << name;
        if (std::isfinite(d.condition) && d.condition < 1e12) {
          EXPECT_NEAR(values[i][0] / d.condition, 1, 1e-14 * cond * cond) << name;
        } else {
          EXPECT_GT(values[i][0], 1e12) << name;
        }
      }
    }
  }
}

TEST(Survey, AllSignsOfTheLegsAreTried) {
  // Six random lines and sizes: every one of the 32 patterns is the farthest for some of them.
  std::mt19937 random(11);
  std::normal_distribution<double> normal;
  const auto strut = std::get<machine::StrutHexapod>(load("hexapod-strut"));
  std::set<int> patterns;
  for (int k = 0; k < 1500; ++k) {
    machine::StrutHexapod m = strut;
    for (int i = 0; i < machine::kLegs; ++i) {
      m.base_joint[i] += 0.03 * Vec3(normal(random), normal(random), normal(random));
      m.platform_joint[i] += 0.03 * Vec3(normal(random), normal(random), normal(random));
    }
    const AnyMachine any(m);
    std::vector<Sized> sizes;
    const auto all = elements(any);
    for (std::size_t e = 0; e < all.size(); ++e)
      if (all[e].group == "leg.length") sizes.push_back({static_cast<int>(e), 1e-5 * std::exp(normal(random))});
    LegKernel kernel(*six_legs_of(any), {Mat3::Identity()});
    ASSERT_TRUE(kernel.set_sizes(any, sizes, Region::box));
    const Pose X{Mat3::Identity(), Vec3(0, 0, 0.075)};
    const auto answer = kernel.ask(LegQuestion::tolerance, X.p);
    const auto exact = worst_case(any, X, *joints_at(any, X), sizes);
    EXPECT_NEAR(answer.mean[0] / exact->position, 1, 1e-9) << k;
    EXPECT_NEAR(answer.mean[1] / exact->orientation, 1, 1e-9) << k;
    // Which pattern: the strut errors that give the farthest point.
    const auto legs = *six_legs_of(any);
    int pattern = 0, last = 0;
    for (int i = 0; i < 6; ++i) {
      const Vec3 arm = legs.end[i], y = X.p + arm - legs.anchor[i], w = y.normalized();
      const double stretch = w.dot(exact->position_error.head<3>()) + arm.cross(w).dot(exact->position_error.tail<3>());
      const int sign = stretch > 0 ? 1 : 0;
      if (i == 5) last = sign;
      pattern |= sign << i;
    }
    patterns.insert(last ? pattern & 31 : ~pattern & 31);
  }
  EXPECT_EQ(patterns.size(), 32u);
}

TEST(Survey, RailDirectionsAndTheToolsLength) {
  const AnyMachine m = load("hexapod-slider");
  const SurveyOptions options = cone(0, 8);
  const auto s = survey(m, options);
  for (const char* key : {"rail.direction", "tool.length"}) {
    const auto sizes = *sized(m, {{key, 0.001}}, true);
    const auto f = tolerance_field(m, *s, options, sizes);
    ASSERT_TRUE(f);
    for (std::size_t i = 0; i < s->inside.size(); i += 11) {
      const Pose X = pose_at(*s, i, 0);
      EXPECT_NEAR(f->position.mean[i] / worst_case(m, X, *joints_at(m, X), sizes)->position, 1, 1e-9) << key;
    }
  }
}

TEST(Survey, TheSameForAnyNumberOfThreadsAndInsideTheWorkspace) {
  const AnyMachine m = load("hexapod-strut");
  SurveyOptions options = cone(20, 20);
  options.workspace.threads = 1;
  const auto one = survey(m, options);
  const auto sizes = *sized(m, {{"all", 0.01}}, true);
  const auto f1 = tolerance_field(m, *one, options, sizes);
  options.workspace.threads = 3;
  const auto three = survey(m, options);
  const auto f3 = tolerance_field(m, *three, options, sizes);
  EXPECT_EQ(one->inside, three->inside);
  EXPECT_EQ(f1->position.mean, f3->position.mean);
  EXPECT_EQ(f1->orientation.worst, f3->orientation.worst);
  std::size_t reached = 0;
  for (std::size_t i = 0; i < one->grid.size(); ++i) {
    const bool in = std::binary_search(one->inside.begin(), one->inside.end(), i);
    const bool samples = workspace::reaches_samples(m, options.workspace, one->orientations, one->grid.at(i));
    EXPECT_TRUE(samples || !in) << i;  // proven or judged inside: then all samples are reached too
    reached += samples ? 1 : 0;
  }
  EXPECT_LT(static_cast<double>(reached - one->inside.size()) / static_cast<double>(reached), 0.02);
  workspace::Options volume = options.workspace;
  EXPECT_NEAR(one->volume / workspace::volume(m, volume)->volume, 1, 0.01);  // 2 % and 1 % between bounds
}

/// Struts without limits of their joints carry the platform mirrored below the base, too: half of the workspace.
TEST(Survey, WhatLiesBeyondSingularPoses) {
  const std::string legs = R"(
family = "strut-hexapod"
base = { radius_mm = 50, pair_angle_deg = 30 }
platform = { radius_mm = 25, pair_angle_deg = 30 }
leg = { length_min_mm = 50, length_max_mm = 90 }
home = { height_mm = 65 }
)";
  SurveyOptions options;
  options.resolution = 12;
  const auto both = *survey(*machine::from_text(legs, "test.toml"), options);
  EXPECT_EQ(both.beyond.points, both.inside.size());
  EXPECT_EQ(2 * both.beyond.beyond, both.beyond.points) << "the grid is symmetric about z = 0";
  const auto above = *survey(*machine::from_text(legs + "limits = { z_min_mm = 0 }\n", "test.toml"), options);
  EXPECT_GT(above.beyond.points, 0U);
  EXPECT_EQ(above.beyond.beyond, 0U);
  EXPECT_EQ((*survey(test::load("lola50"), options)).beyond.points, 0U);
}

TEST(Survey, ABoxAndBadInput) {
  const AnyMachine m = load("hexapod-strut");
  SurveyOptions options = cone(10, 5);
  options.box = {Vec3(-0.005, -0.005, 0.065), Vec3(0.005, 0.005, 0.065)};
  const auto flat = survey(m, options);
  ASSERT_TRUE(flat);
  EXPECT_TRUE(flat->whole_box);
  EXPECT_EQ(flat->inside.size(), 25u);
  EXPECT_EQ(flat->grid.at(24), Vec3(0.005, 0.005, 0.065));
  options.box = {Vec3(-0.005, -0.005, 0.1), Vec3(0.005, 0.005, 0.2)};
  EXPECT_EQ(survey(m, options).error().id, "QU110");
  options.box = {Vec3(0, 0, 0.1), Vec3(0, 0, 0.1)};
  EXPECT_EQ(survey(m, options).error().id, "WS130");
  EXPECT_EQ(survey(m, cone(60, 20)).error().id, "QU110");
  EXPECT_EQ(survey(m, cone(20, 600)).error().id, "WS130");
  SurveyOptions stopped = cone(20, 20);
  stopped.workspace.cancelled = [] { return true; };
  EXPECT_EQ(survey(m, stopped).error().id, "WS110");
}

// Singularities -------------------------------------------------------------------------------------------------------

TEST(Singularity, TheHexapodTurnedByAQuarterCannotBeHeld) {
  // JEL Figure 6.4: platform turned by 90 deg, all struts tangent to one screw (Fichter's singularity).
  const AnyMachine m = load("hexapod-strut");
  const Pose X{rotation_z(units::from_deg(90)), Vec3(0, 0, 0.065)};
  const Singularity s = singularity(m, X, *joints_at(m, X));
  EXPECT_EQ(s.kind, 2);
  EXPECT_LT(s.control, 1e-12);
  EXPECT_NE(in_words(X, s).find("rotates about its own axis"), std::string::npos) << in_words(X, s);
  // The free motion changes no strut to first order: the closure's rows say so, and lengths a step away.
  const double h = 1e-5;
  const Pose Y{rotation_of(h * s.free_motion.tail<3>()) * X.R, X.p + h * s.free_motion.head<3>()};
  const auto q = joints_at(m, X), moved = joints_at(m, Y);
  EXPECT_LT((*moved - *q).cwiseAbs().maxCoeff(), 20 * h * h);
  const Pose upright{Mat3::Identity(), Vec3(0, 0, 0.065)};
  EXPECT_EQ(singularity(m, upright, *joints_at(m, upright)).kind, 0);
}

/// The drives cannot give the lost motion: every twist that they give is square to it, angles as lengths on L.
void expect_lost(const AnyMachine& m, const Pose& X, const machine::JointVector& q, const Singularity& s,
                 double within) {
  const auto scaled = [&](const Vec6& t) {
    Vec6 out = t;
    out.tail<3>() *= s.length;
    return out;
  };
  const auto J = std::visit(
      [&](const auto& one) { return kinematics::jacobian_by_closure(one, X, std::span(q.data(), q.size())); }, m);
  EXPECT_NEAR(scaled(s.lost_motion).norm(), kinematics::is_serial(m) ? s.length : 1, 1e-9);
  for (int i = 0; i < J.cols(); ++i)
    EXPECT_NEAR(scaled(s.lost_motion).dot(scaled(J.col(i))) / J.norm(), 0, within) << i;
}

/// Rods in parallel pairs, and what keeps an orientation, take rotations away whatever the drives do: none is a motion
/// that the drives could lose.
TEST(Singularity, WhatPassiveConstraintsHoldIsNoLostMotion) {
  const AnyMachine delta = load("delta-brno", {{"limits.z_max_mm", "800"}});
  for (const Vec3& p : {Vec3(0, 0, 0.714449), Vec3(0.1, 0.05, 0.6)}) {
    const Pose X{Mat3::Identity(), p};
    const Singularity s = singularity(delta, X, *joints_at(delta, X));
    EXPECT_LT(s.lost_motion.tail<3>().norm() * s.length, 1e-9 * s.lost_motion.head<3>().norm()) << in_words(X, s);
  }
}

TEST(Singularity, AStretchedArmLosesAMotion) {
  // LOLA 50 with upper arm and forearm in line: the wrist centre cannot go further out.
  const AnyMachine m = load("lola50");
  const auto& arm = std::get<machine::SerialArm>(m);
  machine::JointVector q(5);
  q << 0.2, -0.3, 0, 0, 0.5;
  // Upper arm and forearm in line: theta_3 where the closed form's angle between them is 0.
  double best = 1e9;
  for (double t = -2; t < 2; t += 1e-4) {
    machine::JointVector trial = q;
    trial[2] = t;
    const double mobility = singularity(m, machine::forward(arm, trial), trial).mobility;
    if (mobility < best) {
      best = mobility;
      q = trial;
    }
  }
  EXPECT_LT(best, 1e-3);
  const Pose X = machine::forward(arm, q);
  const Singularity s = singularity(m, X, q, 0, 2e-3);
  EXPECT_EQ(s.kind, 1);
  // The lost motion is no combination of the joints' motions; the idle one moves the tool least.
  const auto J = kinematics::jacobian(m, X, q);
  EXPECT_LT((J * s.idle_joints).head<3>().norm(), 5e-3);
  expect_lost(m, X, q, s, 5e-3);  // near the singular pose
  const auto near = nearest(m, X, q);
  ASSERT_TRUE(near);
  EXPECT_LT(near->translation, 0.01);
}

TEST(Singularity, ASliderSquareToItsLegIsOfKindOne) {
  const AnyMachine m = load("hexapod-slider");
  const auto& slider = std::get<machine::SliderHexapod>(m);
  // A pose where leg 1 is square to its rail: the platform joint at leg length across from a point of the rail.
  const Vec3 u = slider.rail_direction[0];
  const Vec3 across = (Vec3::UnitZ() - u * u.z()).normalized();
  const Vec3 joint = slider.rail_outer[0] + 0.5 * slider.rail_length[0] * u + slider.leg_length * across;
  Vec3 end = slider.platform_joint[0];
  end.z() -= slider.tool_length;
  const Pose X{Mat3::Identity(), joint - end};
  machine::JointVector q(6);
  q.setConstant(0.5 * slider.rail_length[0]);  // the other legs do not matter for the first row
  const Singularity s = singularity(m, X, q, 0, 1e-9);
  EXPECT_EQ(s.kind & 1, 1);
  EXPECT_LT(s.mobility, 1e-12);
  EXPECT_NEAR(std::abs(s.idle_joints[0]), 1, 1e-12);
  expect_lost(m, X, q, s, 1e-9);
}

TEST(Singularity, APathThroughOneIsNoticed) {
  // Without joint limits the strut hexapod turns through its singular quarter.
  const AnyMachine m =
      load("hexapod-strut", {{"joint.cone_deg", "175"}, {"leg.length_min_mm", "10"}, {"leg.length_max_mm", "200"}});
  const Pose from{Mat3::Identity(), Vec3(0, 0, 0.065)}, to{rotation_z(units::from_deg(100)), Vec3(0, 0, 0.065)};
  const PathSingularity p = along_path(m, from, to, 37);
  EXPECT_TRUE(p.crossed);
  EXPECT_NEAR(p.share, 0.9, 1e-5);
  EXPECT_EQ(p.at.kind, 2);
  const PathSingularity free = along_path(m, from, {Mat3::Identity(), Vec3(0.005, 0, 0.07)});
  EXPECT_FALSE(free.crossed);
  EXPECT_EQ(free.at.kind, 0);
  const auto near = nearest(m, Pose{rotation_z(units::from_deg(85)), Vec3(0, 0, 0.065)},
                            *joints_at(m, Pose{rotation_z(units::from_deg(85)), Vec3(0, 0, 0.065)}));
  ASSERT_TRUE(near);
  EXPECT_LE(near->rotation, units::from_deg(5.001));
}

TEST(Singularity, MotionsInWords) {
  const Pose X{Mat3::Identity(), Vec3(0.1, 0, 0)};
  const auto say = [&](const Vec3& v, const Vec3& w) {
    Vec6 t;
    t << v, w;
    return motion_in_words(X, t, 0.05);
  };
  EXPECT_EQ(say({0, 0, 0}, {0, 0, 2}), "rotates about its own axis");
  EXPECT_EQ(say({1, 0, 0}, {0, 0, 0}), "moves along x");
  EXPECT_EQ(say({0, 0, 1}, {0, 0, 0}), "moves along its own axis");
  EXPECT_EQ(say({0, 0, 0}, {1, 0, 0}), "rotates about the axis through its tip along x");
  EXPECT_EQ(say({0, 1, 0}, {0, 0, 10}), "rotates about the axis through 0.0, 0.0, 0.0 mm along its own axis");
  EXPECT_EQ(say({0, 0, 0.1}, {0, 0, 10}), "rotates about its own axis and moves along it by 10.0 mm per rad");
}

// Design and budget ---------------------------------------------------------------------------------------------------

double largest_error(const AnyMachine& m, const Survey& s, const SurveyOptions& o,
                     const std::vector<std::pair<std::string, double>>& tolerances) {
  const auto f = tolerance_field(m, s, o, *sized(m, tolerances, true));
  return *std::max_element(f->position.worst.begin(), f->position.worst.end());
}

TEST(ToleranceDesign, MeetsTheWishAndNoMore) {
  const AnyMachine m = load("hexapod-strut");
  SurveyOptions options = cone(10, 9);
  options.box = {Vec3(-0.008, -0.008, 0.06), Vec3(0.008, 0.008, 0.07)};
  const auto s = survey(m, options);
  DesignOptions wish;
  wish.position = 50e-6;
  const auto d = design_tolerances(m, *s, options, {{"leg.length", 1}, {"base.joint", 2}}, wish);
  ASSERT_TRUE(d) << to_string(d.error());
  EXPECT_NEAR(d->position, wish.position, 1e-3 * wish.position);
  EXPECT_NEAR(d->parts[1].tolerance / d->parts[0].tolerance, 2, 1e-12);
  EXPECT_LE(
      largest_error(m, *s, options, {{"leg.length", d->parts[0].tolerance}, {"base.joint", d->parts[1].tolerance}}),
      wish.position * (1 + 1e-9));
  EXPECT_NEAR(d->parts[0].share + d->parts[1].share, 1, 1e-9);

  // Cost: no other pair on the border of the allowed ones is cheaper.
  wish.rule = DesignRule::cost;
  const auto cheap = design_tolerances(m, *s, options, {{"leg.length", 3}, {"base.joint", 1}}, wish);
  ASSERT_TRUE(cheap) << to_string(cheap.error());
  const auto cost = [&](double leg, double base) { return 6 * 3 / leg + 6 * 1 / base; };
  const double leg = cheap->parts[0].tolerance, base = cheap->parts[1].tolerance;
  EXPECT_NEAR(cheap->cost, cost(leg, base), 1e-6 * cheap->cost);
  for (double ratio = 0.1; ratio < 10; ratio *= 1.2) {
    const double scale = units::to_mm(wish.position) /
                         units::to_mm(largest_error(m, *s, options, {{"leg.length", 1}, {"base.joint", ratio}}));
    EXPECT_GT(cost(scale, scale * ratio), cheap->cost * (1 - 5e-3)) << ratio;
  }
  EXPECT_EQ(design_tolerances(m, *s, options, {{"leg.length", 1}, {"leg.length[2]", 1}}, wish).error().id, "QU121");
  EXPECT_EQ(design_tolerances(m, *s, options, {{"leg.length", 0}}, wish).error().id, "QU120");
  wish.position = 0;
  EXPECT_EQ(design_tolerances(m, *s, options, {{"leg.length", 1}}, wish).error().id, "QU120");

  // The orientation alone: of one group the tolerance in proportion to the largest error that was seen.
  DesignOptions turned;
  turned.position = std::numeric_limits<double>::infinity();
  EXPECT_EQ(design_tolerances(m, *s, options, {{"leg.length", 1}}, turned).error().id, "QU120");
  turned.orientation = 1e-3;
  const auto angle = design_tolerances(m, *s, options, {{"leg.length", 1}}, turned);
  ASSERT_TRUE(angle) << to_string(angle.error());
  EXPECT_NEAR(angle->orientation, 1e-3, 1e-6);
  const auto field = *tolerance_field(m, *s, options, *sized(m, {{"leg.length", 1}}, true));
  const double of_one = worst_seen(m, *s, options, field.orientation, field.anywhere, 1).value;
  EXPECT_NEAR(angle->parts[0].tolerance, 1e-3 / of_one, 1e-3 * angle->parts[0].tolerance);
}

TEST(ToleranceDesign, PromisesWhatTheErrorsShow) {
  // A delta's worst poses lie on the boundary of its workspace, which no point of the grid is on.
  const AnyMachine m = test::flat_delta();
  SurveyOptions options;
  const auto s = survey(m, options);
  DesignOptions wish;
  wish.position = 50e-6;
  const auto d = design_tolerances(m, *s, options, {{"all", 1}}, wish);
  ASSERT_TRUE(d) << to_string(d.error());
  EXPECT_EQ(d->parts[0].units, (std::vector<std::string>{"deg", "mm"}));  // lengths, and the drives' zero
  const auto sizes = *sized(m, {{"all", d->parts[0].tolerance}}, true);
  const auto field = tolerance_field(m, *s, options, sizes);
  constexpr double kRounding = 1e-6;
  // Both searches have a bounded number of steps and need not end at the same pose: never above, and no lower than half
  // a per cent.
  const double seen = worst_seen(m, *s, options, field->position, field->anywhere, 0).value;
  EXPECT_LE(seen, (1 + kRounding) * wish.position);
  EXPECT_GE(seen, 0.995 * wish.position);
  // A pose that a finer grid found; the promise leaves a per cent.
  constexpr double kPromised = 1.01;
  const Pose X{Mat3::Identity(), 1e-3 * Vec3(-541.17, -314.30, 705.59)};
  EXPECT_LE(worst_case(m, X, *joints_at(m, X), sizes)->position, kPromised * wish.position);
  SurveyOptions fine;
  fine.resolution = 80;
  const auto dense = survey(m, fine);
  const auto finer = tolerance_field(m, *dense, fine, sizes);
  EXPECT_LE(worst_seen(m, *dense, fine, finer->position, finer->anywhere, 0).value, kPromised * wish.position);
}

TEST(Budget, RowsFromClosedForms) {
  const AnyMachine m = load("hexapod-strut");
  const Pose X{Mat3::Identity(), Vec3(0.003, 0.004, 0.075)};
  const auto q = joints_at(m, X);
  Imperfections known;
  known.warming = 10;
  known.expansion = 10e-6;
  known.resolution.sliding = 2e-6;
  known.repeatability.sliding = 3e-6;
  known.backlash.sliding = 8e-6;
  known.deflection << 1e-6, 2e-6, 2e-6, 0, 0, 0;
  const auto b = budget(m, X, *q, known);
  ASSERT_TRUE(b);
  const auto row = [&](const std::string& name) {
    for (const BudgetRow& r : b->rows)
      if (r.source == name) return r;
    ADD_FAILURE() << name;
    return BudgetRow{};
  };
  // All that is a length grows alike: the machine scales about its base's origin.
  EXPECT_NEAR(row("temperature rise").position, 1e-4 * X.p.norm(), 1e-15);
  EXPECT_NEAR(row("temperature rise").orientation, 0, 1e-15);
  EXPECT_NEAR(row("compliance").position, 3e-6, 1e-15);
  EXPECT_NEAR(row("resolution").position, worst_case(m, X, *q, *sized(m, {{"joint", 1e-3}}, true))->position, 1e-15);
  // The joints' scatter: sqrt of the largest eigenvalue of J J^T.
  const Eigen::Matrix<double, 3, 6> J = kinematics::jacobian(m, X, *q).topRows<3>();
  EXPECT_NEAR(row("repeatability").position, 3e-6 * Eigen::JacobiSVD<Eigen::MatrixXd>(J).singularValues()[0], 1e-15);
  EXPECT_NEAR(row("backlash").position, worst_case(m, X, *q, *sized(m, {{"joint", 4e-3}}, true))->position, 1e-15);
  EXPECT_NEAR(b->accuracy,
              row("temperature rise").position + row("compliance").position + row("resolution").position +
                  row("backlash").position,
              1e-15);
  EXPECT_LT(b->accuracy_rss, b->accuracy);
  EXPECT_EQ(b->repeatability, row("repeatability").position);

  // An arm grows about its base: X_MB.
  const AnyMachine lola = load("lola50");
  const Pose Y = kinematics::pose_of(machine::Task::axis, {0, -1.3, 0, 0, 0});
  const auto joints = joints_at(lola, Y);
  Imperfections warm;
  warm.warming = 5;
  const auto arm = budget(lola, Y, *joints, warm);
  const Vec3 base = std::get<machine::SerialArm>(lola).X_MB.p;
  EXPECT_NEAR(arm->accuracy, 60e-6 * (Y.p - base).norm(), 1e-12);
}

/// Where some joints slide and others turn, each takes the figure in its own unit, as `errors --tolerance joint=` does.
TEST(Budget, EachJointTakesItsOwnUnit) {
  const AnyMachine m = load("tricept-wrist");
  const Pose target = *kinematics::home_pose(m);
  const auto q = joints_at(m, target);
  const Pose X = kinematics::settled(m, target, *q);
  Imperfections known;
  known.resolution = {units::from_mm(0.001), units::from_deg(0.001)};
  known.repeatability = {units::from_mm(0.003), units::from_deg(0.003)};
  known.backlash = {units::from_mm(0.004), units::from_deg(0.004)};
  const auto b = budget(m, X, *q, known);
  ASSERT_TRUE(b);
  SpreadOptions few;
  few.samples = 100;
  const auto scatter = spread(m, X, *q, *sized(m, {{"joint", 0.003}}, true), few);
  for (const BudgetRow& row : b->rows) {
    if (row.source == "repeatability") {
      EXPECT_NEAR(row.position, scatter->rss_position, 1e-15);
      EXPECT_NEAR(row.orientation, scatter->rss_orientation, 1e-15);
    }
    if (row.source != "resolution" && row.source != "backlash") continue;
    const auto worst = worst_case(m, X, *q, *sized(m, {{"joint", row.source == "backlash" ? 0.002 : 0.0005}}, true));
    EXPECT_NEAR(row.position, worst->position, 1e-15) << row.source;
    EXPECT_NEAR(row.orientation, worst->orientation, 1e-15) << row.source;
  }
}

/// A task without x, y, z is surveyed over its own coordinates: every point and every extreme is a pose that the
/// inverse reaches, and the figures there are those of the pose.
TEST(Survey, TasksWithoutPositionsAreOverTheirCoordinates) {
  for (const char* name : {"planar-3rrr", "tripod-z3"}) {
    const AnyMachine m = load(name);
    const machine::Task task = kinematics::task(m);
    SurveyOptions options;
    options.resolution = 8;
    const auto s = survey(m, options);
    ASSERT_TRUE(s) << to_string(s.error());
    EXPECT_EQ(s->orientations.size(), 1U);
    const auto field = dexterity_field(m, *s, options);
    ASSERT_TRUE(field);
    const Vec3 home = workspace::point_of(task, *kinematics::home_pose(m));
    for (std::size_t i = 0; i < s->inside.size(); ++i) {
      const Vec3 p = s->grid.at(s->inside[i]);
      const Pose X = pose_at(*s, i, 0);
      const auto coordinates = kinematics::coordinates_of(task, X);
      for (int k = 0; k < 3; ++k) {
        EXPECT_NEAR(coordinates[static_cast<std::size_t>(k)], p[k], 1e-9);
        if (task.is_angle(k)) {
          EXPECT_LE(std::abs(p[k] - home[k]), std::numbers::pi / 2 + 1e-9);
        }
      }
      const auto result = kinematics::inverse(m, X);
      ASSERT_NE(result.reachable(), nullptr) << name << " " << p.transpose();
      const auto d = kinematics::dexterity(m, X, *joints_at(m, X));
      EXPECT_NEAR(field->condition.mean[i] / d.condition, 1, 1e-6);
    }
    // Searches stay in the workspace, and find no less than the points.
    const Statistics grid = statistics(*s, field->sigma_min.mean);
    const Statistics seen = statistics_seen(m, *s, options, field->sigma_min, field->anywhere, 1);
    EXPECT_LE(seen.min, grid.min);
    EXPECT_GE(seen.max, grid.max);
    for (const Vec3& at : {seen.min_at, seen.max_at}) {
      for (int k = 0; k < 3; ++k)
        if (task.is_angle(k)) {
          EXPECT_LE(std::abs(at[k] - home[k]), std::numbers::pi / 2 + 1e-9);
        }
      EXPECT_NE(kinematics::inverse(m, workspace::pose_at(task, Mat3::Identity(), at)).reachable(), nullptr);
    }
  }
}

/// Angles that are coordinates end a quarter turn from home: no box, and no extreme beside one, goes farther. No
/// tolerance is chosen by a pose close to a singular one.
TEST(Survey, CoordinatesEndAQuarterTurnFromHome) {
  const AnyMachine planar = load("planar-3rrr"), tripod = load("tripod-z3");
  SurveyOptions options;
  options.resolution = 3;
  const double deg = units::from_deg(1);
  options.box = {Vec3(-0.01, -0.01, 80 * deg), Vec3(0.01, 0.01, 120 * deg)};
  const auto far = survey(planar, options);
  ASSERT_FALSE(far);
  EXPECT_EQ(far.error().id, "WS130");
  options.box = {Vec3(-0.01, -0.01, 80 * deg), Vec3(0.01, 0.01, 90 * deg)};
  EXPECT_TRUE(survey(planar, options));
  options.resolution = 2;
  options.box = {Vec3(0.795, -85 * deg, -85 * deg), Vec3(0.805, 85 * deg, 85 * deg)};
  const auto s = survey(tripod, options);
  ASSERT_TRUE(s);
  DesignOptions wanted;
  wanted.position = 0.05e-3;
  const auto design = design_tolerances(tripod, *s, options, {{"all", 1}}, wanted);
  ASSERT_FALSE(design);
  EXPECT_EQ(design.error().id, "QU122");
}

/// Upright and free of limits, the 3-RRR is three cranks: a point is reached where each joint of the platform lies
/// between the lengths of its crank.
TEST(Survey, ASectionOfThePlanarMachineIsThatOfItsCranks) {
  const AnyMachine m = load("planar-3rrr");
  workspace::Options options;
  const auto bits = workspace::limit_bits(m, "length");
  workspace::Plane plane;
  const auto s = workspace::section(m, options, plane, 60);
  ASSERT_TRUE(s) << to_string(s.error());
  EXPECT_EQ(s->task, kinematics::task(m));
  EXPECT_TRUE(s->field.tilt.empty());
  (void)bits;
  // Counted by the inverse on a finer, shifted grid.
  constexpr int kSteps = 400;
  constexpr double kHalf = 0.2;
  int count = 0;
  for (int i = 0; i < kSteps; ++i)
    for (int j = 0; j < kSteps; ++j) {
      const Vec3 p(kHalf * (2 * (i + 0.5) / kSteps - 1), kHalf * (2 * (j + 0.5) / kSteps - 1), 0);
      count += kinematics::inverse(m, Pose{Mat3::Identity(), p}).reachable() != nullptr ? 1 : 0;
    }
  const double counted = count * std::pow(2 * kHalf / kSteps, 2);
  EXPECT_NEAR(s->area / counted, 1, 2e-3);
}

}  // namespace
}  // namespace polypod::quality
