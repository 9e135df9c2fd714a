// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How little a new family takes: the gantry of examples/cpp, a struct and its closure, and what follows from them, by
// itself and as machine::Own.
#include <gtest/gtest.h>

#include "examples/cpp/gantry.hpp"
#include "kinematics/invariants.hpp"
#include "kinematics/legs_alone.hpp"
#include "polypod/core/random.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/families.hpp"

namespace polypod::toy {

using gantry::Gantry;

static_assert(kinematics::Machine<Gantry>);

namespace {

Pose forward(const Gantry& g, const machine::JointVector& q) {
  return kinematics::forward_by_closure(g, std::span<const double>(q.data(), q.size()), Pose{}).X_MT;
}
machine::JacobianMatrix jacobian(const Gantry& g, const Pose& X, const machine::JointVector& q) {
  return kinematics::jacobian_by_closure(g, X, std::span<const double>(q.data(), q.size()));
}

TEST(ToyFamily, KeepsTheInvariantsFromItsClosureAlone) {
  const Gantry g{0.5, 0.02};
  testing::check_invariants(
      g, [&](const auto& q) { return forward(g, q); },
      [&](const Pose& X) {
        return kinematics::inverse_damped(
            g, X, [&](const auto& q) { return forward(g, q); },
            [&](const Pose& at, const auto& q) { return jacobian(g, at, q); });
      },
      [&](const Pose& X, const auto& q) { return jacobian(g, X, q); });
}

TEST(ToyFamily, ParameterErrorInFirstOrder) {
  const Gantry g{0.5, 0.0};
  const double q[3] = {0.1, 0.2, -0.1};
  const std::vector<double> p = kinematics::nominal_parameters(g);
  const Pose X{Mat3::Identity(), Vec3(0.1, 0.2, -0.1)};
  // dX = -A^-1 F_p dp: a y slide at 0.2 m that leans by dp moves the tool by -0.2 dp in x.
  const Eigen::MatrixXd dX =
      -(kinematics::closure_by_pose(g, X, q, p).inverse() * kinematics::closure_by_parameters(g, X, q, p));
  EXPECT_NEAR(dX(0, 0), -0.2, 1e-15);
  EXPECT_NEAR(dX.col(0).tail(5).norm(), 0.0, 1e-15);
}

using legs_alone::Legs;

TEST(OwnFamily, KeepsTheInvariants) {
  const machine::AnyMachine any = machine::own(Gantry{0.5, 0.02});
  testing::check_invariants(
      std::get<machine::Own>(any), [&](const auto& q) { return kinematics::forward(any, q).poses.at(0); },
      [&](const Pose& X) { return kinematics::inverse(any, X); },
      [&](const Pose& X, const auto& q) { return kinematics::jacobian(any, X, q); });
}

class OwnFamilyOfLegs : public ::testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(Catalogue, OwnFamilyOfLegs, ::testing::Values("tricept", "tripod-z3", "hexa", "planar-3rrr"),
                         [](const auto& one) {
                           std::string name = one.param;
                           std::erase(name, '-');
                           return name;
                         });

// What the catalogue's machine has in closed form follows from its closure, to rounding: the tool of a Tricept tilts,
// that of the tripod moves sideways, and no pose prescribes it.
TEST_P(OwnFamilyOfLegs, IsWhatItsClosedFormsAre) {
  const auto known = machine::load(GetParam());
  ASSERT_TRUE(known);
  const machine::AnyMachine any = machine::own(Legs{std::get<machine::Parallel>(*known)});
  const machine::Task what = kinematics::task(*known);
  const Pose home = *kinematics::home_pose(*known);
  const std::vector<double> at_home = kinematics::coordinates_of(what, home);
  Random random(7);
  int compared = 0;
  for (int k = 0; k < 40; ++k) {
    std::vector<double> at = at_home;
    for (std::size_t i = 0; i < at.size(); ++i) {
      at[i] += (what.is_angle(static_cast<int>(i)) ? 0.15 : 0.05) * random.uniform(-1, 1);
    }
    const Pose target = kinematics::pose_of(what, at);
    const kinematics::InverseResult wanted = kinematics::inverse(*known, target);
    if (wanted.reachable() == nullptr) continue;
    const machine::JointVector& q = wanted.reachable()->joints;
    const kinematics::InverseResult found = kinematics::inverse(any, target);
    const bool holds = std::any_of(found.solutions.begin(), found.solutions.end(), [&](const auto& s) {
      return (s.joints - q).cwiseAbs().maxCoeff() < 1e-8 && s.violations == 0;
    });
    EXPECT_TRUE(holds) << found.solutions.size();
    const Pose X = kinematics::settled(*known, target, q), X_own = kinematics::settled(any, target, q);
    EXPECT_LT((X.p - X_own.p).norm() + (X.R - X_own.R).norm(), 1e-10);
    const auto J = kinematics::jacobian(*known, target, q), J_own = kinematics::jacobian(any, target, q);
    EXPECT_LT((J - J_own).norm(), 1e-7 * J.norm());
    const auto forward = kinematics::forward(any, q);
    ASSERT_EQ(forward.poses.size(), 1U);
    EXPECT_LT((forward.poses[0].p - kinematics::forward(*known, q).poses.at(0).p).norm(), 1e-9);
    ++compared;
  }
  EXPECT_GT(compared, 20);
}

TEST(OwnFamily, OfPolypodsNamesIsRefused) {
  EXPECT_THROW(machine::own_detail::add_reader("serial", {}), std::invalid_argument);
}

}  // namespace
}  // namespace polypod::toy
