// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The row "calibration" of the budget, against machines that are drawn from the covariance.
#include "polypod/quality/budget.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "polypod/core/random.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/families.hpp"

namespace polypod::quality {
namespace {

using kinematics::AnyMachine;

const BudgetRow& row_of(const Budget& b, const std::string& source) {
  return *std::find_if(b.rows.begin(), b.rows.end(), [&](const BudgetRow& r) { return r.source == source; });
}

/// A root L of a covariance L L^T whose parameters hang together: lengths to some 10 um, angles to some 0.05 mrad.
Eigen::MatrixXd root_for(const AnyMachine& m, Random& random) {
  const std::vector<machine::Parameter> all = kinematics::parameters(m);
  const Eigen::Index n = std::ssize(all);
  Eigen::MatrixXd L(n, n);
  for (double& x : L.reshaped()) x = random.normal() / std::sqrt(double(n));
  for (Eigen::Index k = 0; k < n; ++k) {
    const std::string& unit = all[std::size_t(k)].unit;
    L.row(k) *= unit == "mm" ? 10e-6 : unit == "deg" ? 50e-6 : 1e-5;
  }
  return L;
}

double longest_axis(const Eigen::MatrixXd& points) {
  const Eigen::MatrixXd off = points.colwise() - points.rowwise().mean();
  const Mat3 covariance = off * off.transpose() / double(points.cols() - 1);
  return std::sqrt(Eigen::SelfAdjointEigenSolver<Mat3>(covariance).eigenvalues()[2]);
}

// 4000 machines a case, whose closures are solved, not linearised: the standard deviation of 4000 is known to 1.1 %,
// the longest of three axes lies a little higher; four of these.
TEST(Budget, CalibrationIsWhatDrawnMachinesScatterBy) {
  constexpr int kDraws = 4000;
  constexpr double kSlack = 0.045;
  for (const char* name : {"lola50", "hexapod-strut", "hexapod-slider", "delta-linear"}) {
    SCOPED_TRACE(name);
    const AnyMachine m = *machine::load(name);
    Random random(7);
    const Eigen::MatrixXd L = root_for(m, random);
    const Pose target = kinematics::home_pose(m).value_or(Pose{Mat3::Identity(), Vec3(0.1, -1.3, 0)});
    const kinematics::InverseResult inverse = kinematics::inverse(m, target);
    ASSERT_TRUE(inverse.reachable());
    const machine::JointVector q = inverse.reachable()->joints;
    const Pose X = kinematics::settled(m, target, q);
    Imperfections known;
    known.covariance = L * L.transpose();
    const auto b = budget(m, X, q, known);
    ASSERT_TRUE(b) << to_string(b.error());
    const BudgetRow& row = row_of(*b, "calibration");
    EXPECT_EQ(row.kind, "geometric");

    const bool axis = kinematics::task(m).names_axis();
    Eigen::MatrixXd tips(3, kDraws), turns(3, kDraws);
    for (int i = 0; i < kDraws; ++i) {
      Eigen::VectorXd z(L.cols());
      for (double& x : z) x = random.normal();
      const Eigen::VectorXd dp = L * z;
      const Pose at = std::visit(
          [&](const auto& one) {
            std::vector<double> p = kinematics::nominal_parameters(one);
            for (std::size_t k = 0; k < p.size(); ++k) p[k] += dp[Eigen::Index(k)];
            const std::span<const double> joints(q.data(), std::size_t(q.size()));
            const auto solved = kinematics::forward_by_closure(one, joints, p, X);
            EXPECT_TRUE(solved.converged);
            return solved.X_MT;
          },
          m);
      Vec3 turn = rotation_vector(at.R * X.R.transpose());
      if (axis) turn -= X.R.col(2) * X.R.col(2).dot(turn);
      tips.col(i) = at.p - X.p;
      turns.col(i) = turn;
    }
    EXPECT_NEAR(row.position / (2 * longest_axis(tips)), 1, kSlack);
    const double turned = 2 * longest_axis(turns);
    if (turned > 1e-9) {
      EXPECT_NEAR(row.orientation / turned, 1, kSlack);
    } else {
      EXPECT_LT(row.orientation, 1e-9);
    }
    // It is the only thing that is off, and counts in both sums.
    EXPECT_GT(row.position, 0);
    EXPECT_EQ(b->accuracy, row.position);
    EXPECT_NEAR(b->accuracy_rss, row.position, 1e-12);
    EXPECT_EQ(b->accuracy_orientation, row.orientation);
    EXPECT_EQ(b->repeatability, 0);
  }
}

TEST(Budget, WithoutACovarianceTheRowIsZero) {
  const AnyMachine m = *machine::load("lola50");
  const Pose X{Mat3::Identity(), Vec3(0, -1.3, 0)};
  const auto b = budget(m, X, kinematics::inverse(m, X).reachable()->joints, {});
  ASSERT_TRUE(b) << to_string(b.error());
  EXPECT_EQ(row_of(*b, "calibration").position, 0);
  EXPECT_EQ(b->accuracy, 0);
}

}  // namespace
}  // namespace polypod::quality
