// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What must hold for every family of machines. A new family calls check_invariants once and has its tests.
#pragma once

#include <gtest/gtest.h>

#include <random>

#include "polypod/core/box_number.hpp"
#include "polypod/kinematics/closure.hpp"

namespace polypod::testing {

// Rounding of a chain of a few links of about 1 m: some 1e-15 each, times the conditioning of the inverse.
inline constexpr double kRoundTrip = 1e-9;
// Central differences with step 1e-6: truncation 1e-12, rounding 1e-16/1e-6 = 1e-10 of a length of 1 m.
inline constexpr double kDifference = 2e-8;

struct InvariantOptions {
  int samples = 200;
  std::uint32_t seed = 20260901;
  double share = 0.9;  ///< of each joint's range that is sampled, round its middle
};

/// Joints within `reach` of q, one variable each, and exact parameters.
struct BoxNumbers {
  BoxDomain domain;
  std::vector<BoxNumber> q, p;

  BoxNumbers(const kinematics::JointVector& at, const std::vector<double>& parameters, double reach)
      : p(parameters.begin(), parameters.end()) {
    domain.count = static_cast<std::size_t>(at.size());
    for (std::size_t k = 0; k < domain.count; ++k) {
      domain.reach[k] = reach;
      BoxNumber joint(at[static_cast<Eigen::Index>(k)], &domain);
      joint.set_gradient(k, 1);
      q.push_back(joint);
    }
  }
  BoxNumbers(const BoxNumbers&) = delete;
  BoxNumbers& operator=(const BoxNumbers&) = delete;
};

/// Numbers without a domain round as others do, in an order of their own.
inline bool holds(const BoxNumber& g, double value) {
  constexpr double kRounding = 1e-13;
  return g.lo() - kRounding <= value && value <= g.hi() + kRounding;
}

/// forward and inverse are the family's own functions; `same` compares poses as far as the task sees them.
template <kinematics::Machine M, class Forward, class Inverse, class JacobianOf>
void check_invariants(const M& m, Forward&& forward_of, Inverse&& inverse_of, JacobianOf&& jacobian_of,
                      const InvariantOptions& options = {}) {
  using kinematics::JointVector;
  SCOPED_TRACE("seed " + std::to_string(options.seed));
  std::mt19937 random(options.seed);
  std::uniform_real_distribution<double> unit(-1, 1);
  const int n = joint_count(m);
  const std::vector<double> p = kinematics::nominal_parameters(m);
  for (int k = 0; k < options.samples; ++k) {
    SCOPED_TRACE("sample " + std::to_string(k));
    JointVector q(n);
    for (int i = 0; i < n; ++i) {
      const auto range = joint_range(m, i);
      q[i] = 0.5 * (range.min + range.max) + 0.5 * options.share * unit(random) * (range.max - range.min);
    }
    const std::span<const double> q_span(q.data(), q.size());
    const Pose X = forward_of(q);

    // The closure vanishes at (forward(q), q), and Newton on it comes back from a neighbouring pose.
    const kinematics::ClosureVector F = closure(m, X, q_span, std::span<const double>(p));
    ASSERT_LT(F.cwiseAbs().maxCoeff(), kRoundTrip);
    Pose near = X;
    near.p += Vec3(1e-3, -2e-3, 1e-3);
    near.R = rotation_of(Vec3(0.01, -0.02, 0.015)) * near.R;
    const kinematics::NewtonResult newton = kinematics::forward_by_closure(m, q_span, near);
    ASSERT_TRUE(newton.converged);
    EXPECT_LE(newton.iterations, 6);
    EXPECT_LT((newton.X_MT.p - X.p).norm(), kRoundTrip);
    EXPECT_LT((newton.X_MT.R - X.R).norm(), kRoundTrip);

    // The generating joints are among the inverse's solutions, and every solution leads back to the pose.
    const kinematics::InverseResult inverse = inverse_of(X);
    ASSERT_FALSE(inverse.solutions.empty());
    bool found = false;
    for (const kinematics::Solution& s : inverse.solutions) {
      const Vec6 e = kinematics::closure_detail::pose_error(task(m), X, forward_of(s.joints));
      EXPECT_LT(e.norm(), 1e-7) << s.branch;
      if ((s.joints - q).cwiseAbs().maxCoeff() < 1e-6) {
        found = true;
        EXPECT_EQ(s.violations, kinematics::LimitBits{0}) << s.branch;
      }
    }
    EXPECT_TRUE(found) << "the generating joints are missing";

    // The Jacobian against central differences, and against the closure's own.
    const kinematics::JacobianMatrix J = jacobian_of(X, q);
    ASSERT_EQ(J.cols(), n);
    const double h = 1e-6;
    for (int i = 0; i < n; ++i) {
      JointVector plus = q, minus = q;
      plus[i] += h;
      minus[i] -= h;
      const Pose a = forward_of(plus), b = forward_of(minus);
      Vec6 column;
      column << (a.p - b.p) / (2 * h), rotation_vector(a.R * b.R.transpose()) / (2 * h);
      EXPECT_LT((J.col(i) - column).norm(), kDifference * (1 + column.norm())) << "joint " << i;
    }
    EXPECT_LT((J - kinematics::jacobian_by_closure(m, X, q_span)).norm(), 1e-10 * (1 + J.norm()));

    // Power balance: what the drives give, by J^T W, is what the tool takes, by differences of forward kinematics.
    const Vec6 wrench = Vec6::NullaryExpr([&] { return unit(random); });
    const JointVector speed = JointVector::NullaryExpr(n, [&] { return unit(random); });
    const Pose ahead = forward_of(JointVector(q + h * speed)), behind = forward_of(JointVector(q - h * speed));
    Vec6 twist;
    twist << (ahead.p - behind.p) / (2 * h), rotation_vector(ahead.R * behind.R.transpose()) / (2 * h);
    EXPECT_NEAR((J.transpose() * wrench).dot(speed), wrench.dot(twist),
                kDifference * (1 + wrench.norm() * twist.norm()));

    // Intervals hold the doubles: a small box round (X, q) contains the closure's and the limits' values.
    std::vector<Interval> q_box(q.data(), q.data() + q.size()), p_box(p.begin(), p.end());
    for (Interval& v : q_box) v = Interval(v.lo() - 1e-3, v.hi() + 1e-3);
    const auto F_box =
        closure(m, X.cast<Interval>(), std::span<const Interval>(q_box), std::span<const Interval>(p_box));
    const auto g_box =
        limits(m, X.cast<Interval>(), std::span<const Interval>(q_box), std::span<const Interval>(p_box));
    const BoxNumbers numbers(q, p, 1e-3);
    const auto g_numbers =
        limits(m, X.cast<BoxNumber>(), std::span<const BoxNumber>(numbers.q), std::span<const BoxNumber>(numbers.p));
    JointVector moved = q;
    for (int i = 0; i < n; ++i) moved[i] += 1e-3 * unit(random);
    const std::span<const double> moved_span(moved.data(), moved.size());
    const auto F_moved = closure(m, X, moved_span, std::span<const double>(p));
    const auto g_moved = limits(m, X, moved_span, std::span<const double>(p));
    for (int i = 0; i < F_moved.size(); ++i) EXPECT_TRUE(F_box[i].contains(F_moved[i])) << "equation " << i;
    for (std::size_t i = 0; i < g_moved.size(); ++i) EXPECT_TRUE(g_box[i].contains(g_moved[i])) << "limit " << i;
    ASSERT_EQ(g_box.size(), g_moved.size());
    ASSERT_EQ(g_numbers.size(), g_moved.size());
    for (std::size_t i = 0; i < g_moved.size(); ++i) {
      EXPECT_TRUE(holds(g_numbers[i], g_moved[i])) << "limit " << i;
      EXPECT_LT(g_numbers[i].radius(), 1.0) << "limit " << i << " says nothing";
    }
    EXPECT_LE(g_moved.size(), 64u);
  }
}

}  // namespace polypod::testing
