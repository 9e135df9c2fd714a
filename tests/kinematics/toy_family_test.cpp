// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How little a new family takes: a gantry of three crossed slides whose rails may be out of square. Its struct, seven
// short functions, and it has forward and inverse kinematics, Jacobians, parameter errors and limits in intervals.
#include <gtest/gtest.h>

#include "kinematics/invariants.hpp"

namespace polypod::toy {

using machine::JointKind;
using machine::JointRange;
using machine::Parameter;
using machine::Task;

struct Gantry {
  double travel = 0.5;       ///< m, of each slide
  double out_of_square = 0;  ///< rad, of the y slide towards x
};

int joint_count(const Gantry&) {
  return 3;
}
JointKind joint_kind(const Gantry&, int) {
  return JointKind::prismatic;
}
JointRange joint_range(const Gantry& g, int) {
  return {-g.travel, g.travel};
}
Task task(const Gantry&) {
  return Task::point;
}
std::vector<Parameter> parameters(const Gantry& g) {
  return {{"out_of_square", g.out_of_square, "deg"}};
}

template <class T>
machine::ClosureVectorT<T> closure(const Gantry&, const PoseT<T>& X, std::span<const T> q, std::span<const T> p) {
  using std::cos, std::sin;
  machine::ClosureVectorT<T> F(6);
  F[0] = X.p[0] - q[0] + q[1] * sin(p[0]);
  F[1] = X.p[1] - q[1] * cos(p[0]);
  F[2] = X.p[2] - q[2];
  F[3] = T(0.5) * (X.R(2, 1) - X.R(1, 2));  // the carriage does not turn
  F[4] = T(0.5) * (X.R(0, 2) - X.R(2, 0));
  F[5] = T(0.5) * (X.R(1, 0) - X.R(0, 1));
  return F;
}

template <class T>
std::vector<T> limits(const Gantry& g, const PoseT<T>&, std::span<const T> q, std::span<const T>) {
  std::vector<T> out;
  for (const T& x : q) {
    out.push_back(x + T(g.travel));
    out.push_back(T(g.travel) - x);
  }
  return out;
}
std::string limit_name(const Gantry&, int i) {
  return "slide " + std::to_string(i / 2 + 1);
}

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

}  // namespace
}  // namespace polypod::toy
