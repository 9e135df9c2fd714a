// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Certain workspaces that follow from a closure and its limits alone: families of one's own against closed forms,
// against the bounds of the built-in family of legs, and against samples; first-order numbers against the functions
// that they enclose.
#include <gtest/gtest.h>

#include "examples/cpp/gantry.hpp"
#include "kinematics/legs_alone.hpp"
#include "machines.hpp"
#include "polypod/core/box_number.hpp"
#include "polypod/core/random.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/families.hpp"
#include "polypod/workspace/shape.hpp"
#include "polypod/workspace/volume.hpp"

namespace polypod::own_bounds {

using machine::AnyMachine;

using legs_alone::Legs;

/// Slides whose limits nobody states.
struct Endless {
  static constexpr std::string_view kFamily = "endless";
  gantry::Gantry g;
};
std::string to_toml(const Endless&) {
  return "";
}
int joint_count(const Endless& e) {
  return joint_count(e.g);
}
machine::JointKind joint_kind(const Endless& e, int i) {
  return joint_kind(e.g, i);
}
machine::JointRange joint_range(const Endless& e, int i) {
  return joint_range(e.g, i);
}
machine::Task task(const Endless& e) {
  return task(e.g);
}
std::vector<machine::Parameter> parameters(const Endless& e) {
  return parameters(e.g);
}
template <class T>
machine::ClosureVectorT<T> closure(const Endless& e, const PoseT<T>& X, std::span<const T> q, std::span<const T> p) {
  return closure(e.g, X, q, p);
}
template <class T>
std::vector<T> limits(const Endless&, const PoseT<T>&, std::span<const T> q, std::span<const T>) {
  return {T(0.3) - q[0]};  // nothing holds the other ends
}
std::string limit_name(const Endless&, int) {
  return "end";
}

namespace {

workspace::Options options(double tolerance) {
  workspace::Options out;
  out.relative_tolerance = tolerance;
  return out;
}

TEST(BoundsByClosure, OfAGantryAreExact) {
  const double angle = 0.02;
  const AnyMachine m = machine::own(gantry::Gantry{0.5, angle});
  EXPECT_TRUE(workspace::has_bounds(m));
  const auto v = workspace::volume(m, options(0.01));
  ASSERT_TRUE(v.has_value()) << to_string(v.error());
  EXPECT_TRUE(v->proven);
  EXPECT_TRUE(v->converged);
  const double truth = std::cos(angle);  // a sheared cube of 1 m
  EXPECT_LE(v->lower, truth * (1 + 1e-12));
  EXPECT_GE(v->upper, truth * (1 - 1e-12));
  EXPECT_LE(v->upper - v->lower, 0.01 * v->volume * (1 + 1e-9));
  const double x = 0.5 + 0.5 * std::sin(angle), y = 0.5 * std::cos(angle);
  for (const double side : {-1.0, 1.0}) {
    const Vec3& end = side < 0 ? v->min : v->max;
    EXPECT_NEAR(end.x(), side * x, 1e-4);
    EXPECT_NEAR(end.y(), side * y, 1e-4);
    EXPECT_NEAR(end.z(), side * 0.5, 1e-4);
  }
}

TEST(BoundsByClosure, AShapeIsHeldOrNot) {
  const AnyMachine m = machine::own(gantry::Gantry{0.5, 0.02});
  const auto holds = [&](const Vec3& half) {
    return *workspace::certainly_holds(m, {}, {workspace::ShapeKind::box, Vec3::Zero(), half});
  };
  EXPECT_TRUE(holds(Vec3(0.48, 0.48, 0.49)));
  EXPECT_FALSE(holds(Vec3(0.5, 0.48, 0.49)));  // its corners in y are out
}

TEST(BoundsByClosure, WhatHasNoEndIsNotProven) {
  const AnyMachine endless = machine::own(Endless{gantry::Gantry{0.5, 0.0}});
  EXPECT_FALSE(workspace::has_bounds(endless));
  workspace::Options without = options(0.2);
  const AnyMachine m = machine::own(gantry::Gantry{0.5, 0.02});
  without.limits = ~workspace::LimitBits{1};  // one end of a slide
  const auto v = workspace::volume(m, without);
  ASSERT_TRUE(v.has_value());
  EXPECT_FALSE(v->proven);
  const workspace::Shape cube{workspace::ShapeKind::box, Vec3::Zero(), Vec3::Constant(0.1)};
  EXPECT_EQ(workspace::certainly_holds(m, without, cube).error().id, "WS102");
}

class BoundsByClosureOfLegs : public ::testing::TestWithParam<std::pair<const char*, double>> {};
INSTANTIATE_TEST_SUITE_P(Catalogue, BoundsByClosureOfLegs,
                         ::testing::Values(std::pair{"tricept", 0.05}, std::pair{"tripod-z3", 0.2}),
                         [](const auto& one) {
                           std::string name = one.param.first;
                           std::erase(name, '-');
                           return name;
                         });

TEST_P(BoundsByClosureOfLegs, HoldThoseOfTheFamilyAndASample) {
  const auto [name, tolerance] = GetParam();
  const AnyMachine known = test::load(name);
  const AnyMachine any = machine::own(Legs{std::get<machine::Parallel>(known)});
  workspace::Options o = options(tolerance);
  o.bounds_tolerance = 0;
  const auto v = workspace::volume(any, o);
  ASSERT_TRUE(v.has_value()) << to_string(v.error());
  EXPECT_TRUE(v->proven);
  EXPECT_TRUE(v->converged);
  const auto built_in = workspace::volume(known, o);
  ASSERT_TRUE(built_in.has_value());
  EXPECT_LE(v->lower, built_in->upper);
  EXPECT_GE(v->upper, built_in->lower);
  // What the inverse reaches lies within the box and, in number, between the bounds.
  const machine::Task task = kinematics::task(any);
  Vec3 margin = 0.05 * (v->max - v->min);
  for (int i = 0; i < 3; ++i) {
    if (!task.places() && task.is_angle(i)) margin[i] = 0;  // angles are looked at within 90 deg of home
  }
  const Vec3 low = v->min - margin, size = v->max + margin - low;
  Random random(5);
  constexpr int kPoints = 1500;
  int inside = 0;
  for (int k = 0; k < kPoints; ++k) {
    const Vec3 p = low + Vec3(random.uniform(0, 1), random.uniform(0, 1), random.uniform(0, 1)).cwiseProduct(size);
    const Pose X = task.places() ? Pose{Mat3::Identity(), p} : kinematics::pose_of(task, {p[0], p[1], p[2]});
    if (kinematics::inverse(any, X).reachable() == nullptr) continue;
    ++inside;
    EXPECT_TRUE((p.array() >= v->min.array()).all() && (p.array() <= v->max.array()).all()) << p.transpose();
  }
  const double share = double(inside) / kPoints, seen = share * size.prod();
  const double five_sigmas = 5 * size.prod() * std::sqrt(share * (1 - share) / kPoints);
  EXPECT_GT(seen + five_sigmas, v->lower);
  EXPECT_LT(seen - five_sigmas, v->upper);
}

/// Every operation encloses what it stands for, at random points of random boxes.
TEST(BoxNumbers, EncloseWhatTheyStandFor) {
  Random random(11);
  for (int k = 0; k < 2000; ++k) {
    BoxDomain d;
    d.count = 3;
    d.reach = {random.uniform(0, 0.4), random.uniform(0, 0.4), random.uniform(0, 0.4)};
    const std::array<double, 3> at{random.uniform(-2, 2), random.uniform(-2, 2), random.uniform(1, 3)};
    std::array<BoxNumber, 3> x{BoxNumber(at[0], &d), BoxNumber(at[1], &d), BoxNumber(at[2], &d)};
    for (std::size_t i = 0; i < 3; ++i) x[i].set_gradient(i, 1);
    const auto f = [](const auto& a, const auto& b, const auto& c, int which) {
      using std::abs, std::cos, std::sin, std::sqrt, polypod::square;
      using T = std::decay_t<decltype(a)>;
      switch (which) {
        case 0:
          return T(a * b - c * a);
        case 1:
          return T(square(a + b) * sin(c));
        case 2:
          return T(sqrt(square(a) + square(b) + c) - cos(a * b));
        case 3:
          return T(a / c + abs(b));
        case 4:
          return T(b / (T(0.0) - c) - T(2.0) * a);
        case 5:
          return T(a * a + b * b - c * c);
        default:
          return T(sin(square(a)) / sqrt(c));
      }
    };
    std::array<double, 3> off{};
    for (std::size_t i = 0; i < 3; ++i) off[i] = random.uniform(-1, 1) * d.reach[i];
    for (int which = 0; which < 7; ++which) {
      const BoxNumber enclosed = f(x[0], x[1], x[2], which);
      const double value = f(at[0] + off[0], at[1] + off[1], at[2] + off[2], which);
      double line = enclosed.value();
      for (std::size_t i = 0; i < 3; ++i) line += enclosed.gradient(i) * off[i];
      EXPECT_LE(std::abs(value - line), enclosed.rest() + 1e-15) << which;
      EXPECT_LE(enclosed.lo(), value);
      EXPECT_GE(enclosed.hi(), value);
    }
    // Of second order: with a tenth of the box the rest is a hundredth, but for rounding.
    BoxDomain small = d;
    for (double& r : small.reach) r *= 0.1;
    std::array<BoxNumber, 3> y{BoxNumber(at[0], &small), BoxNumber(at[1], &small), BoxNumber(at[2], &small)};
    for (std::size_t i = 0; i < 3; ++i) y[i].set_gradient(i, 1);
    for (const int which : {0, 1}) {
      EXPECT_LE(f(y[0], y[1], y[2], which).rest(), 0.02 * f(x[0], x[1], x[2], which).rest() + 1e-13);
    }
  }
}

}  // namespace
}  // namespace polypod::own_bounds
