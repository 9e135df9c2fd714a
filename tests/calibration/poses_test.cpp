// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/calibration/poses.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <limits>

#include "polypod/core/random.hpp"
#include "polypod/core/units.hpp"

namespace polypod::calibration {
namespace {

AnyMachine lola() {
  return *machine::load("lola50");
}
std::vector<Eigen::MatrixXd> some(const std::vector<Eigen::MatrixXd>& all, const std::vector<std::size_t>& chosen) {
  std::vector<Eigen::MatrixXd> out;
  for (const std::size_t i : chosen) out.push_back(all[i]);
  return out;
}
double determinant(const std::vector<Eigen::MatrixXd>& equations) {
  Eigen::MatrixXd M = Eigen::MatrixXd::Zero(equations[0].cols(), equations[0].cols());
  for (const Eigen::MatrixXd& J : equations) M += J.transpose() * J;
  return M.determinant();
}

// Every set of 4 out of 12, by brute force: the exchange's local optimum is the best one, or within 5 % of its axes.
TEST(Poses, ExchangeAgainstEverySet) {
  Random random(8);
  for (int trial = 0; trial < 20; ++trial) {
    std::vector<Eigen::MatrixXd> candidates(12, Eigen::MatrixXd(1, 3));
    for (Eigen::MatrixXd& J : candidates)
      for (double& x : J.reshaped()) x = random.normal();
    double best = 0;
    for (unsigned set = 0; set < 4096; ++set) {
      if (std::popcount(set) != 4) continue;
      std::vector<std::size_t> chosen;
      for (std::size_t i = 0; i < 12; ++i)
        if ((set >> i & 1U) != 0) chosen.push_back(i);
      best = std::max(best, determinant(some(candidates, chosen)));
    }
    const auto chosen = choose(candidates, 4, Criterion::determinant);
    ASSERT_TRUE(chosen);
    const double found = determinant(some(candidates, *chosen));
    EXPECT_LE(found, best * (1 + 1e-9));
    EXPECT_GT(std::pow(found / best, 1 / 6.0), 0.95);
  }
}

TEST(Poses, UncertaintyInClosedForm) {
  // Two unknowns, measured 4 and 9 times with derivatives 1 and 2 (in standard deviations).
  std::vector<Eigen::MatrixXd> equations;
  for (int i = 0; i < 4; ++i) equations.emplace_back(Eigen::RowVector2d(1, 0));
  for (int i = 0; i < 9; ++i) equations.emplace_back(Eigen::RowVector2d(0, 2));
  const Uncertainty u = uncertainty(equations, {Eigen::RowVector2d(3, 0)});
  EXPECT_NEAR(u.worst, 1 / 2.0, 1e-12);
  EXPECT_NEAR(u.mean, std::sqrt(1 / 2.0 * 1 / 6.0), 1e-12);
  EXPECT_NEAR(u.reading, 3 / 2.0, 1e-12);
  EXPECT_TRUE(std::isinf(uncertainty({Eigen::RowVector2d(1, 0)}, equations).worst));
}

// What is predicted is what comes out: the tip's error at other poses after calibrations from the chosen ones.
TEST(Poses, ThePredictedUncertaintyComesTrue) {
  const AnyMachine nominal = lola(), truth = *perturbed(nominal, 0.1e-3, 1e-3, 7);
  CalibrationOptions options;
  options.hold_back = 0;
  const Candidates from = *geometry_candidates(nominal, 200, 4, Kind::point, {}, options);
  const auto chosen = choose(from.equations, 25, Criterion::determinant);
  ASSERT_TRUE(chosen) << to_string(chosen.error());
  const double predicted = uncertainty(some(from.equations, *chosen), from.equations).reading * options.noise_position;
  Random random(5);
  double sum = 0, count = 0;
  for (int trial = 0; trial < 60; ++trial) {
    std::vector<Measurement> rows;
    for (const std::size_t i : *chosen) {
      Measurement row;
      row.q = from.stands[i].q;
      row.X_SR = kinematics::forward(truth, row.q).poses.at(0);
      for (double& x : row.X_SR.p) x += options.noise_position * random.normal();
      rows.push_back(row);
    }
    const auto c = calibrate(nominal, rows, options);
    ASSERT_TRUE(c) << to_string(c.error());
    for (std::size_t i = 0; i < from.stands.size(); i += 5) {
      const auto& q = from.stands[i].q;
      sum += (kinematics::forward(c->machine, q).poses.at(0).p - kinematics::forward(truth, q).poses.at(0).p)
                 .squaredNorm();
      count += 3;
    }
  }
  EXPECT_NEAR(std::sqrt(sum / count) / predicted, 1, 0.1);  // 60 trials of 18 unknowns: 2 % and the sample of stands
}

TEST(Poses, ThirtyPercentBetterThanAGrid) {
  const AnyMachine m = lola();
  const Candidates geometry = *geometry_candidates(m, 400, 1, Kind::point, {}, {});
  const std::vector<Stand> grid = grid_stands(m, geometry.stands, 40, units::from_deg(20));
  ASSERT_EQ(grid.size(), 40u);
  const Uncertainty plain = uncertainty(geometry_equations(m, grid, Kind::point, {}, {}, geometry), geometry.equations);
  ASSERT_TRUE(std::isfinite(plain.worst));
  for (const Criterion criterion : {Criterion::determinant, Criterion::eigenvalue}) {
    const Uncertainty best =
        uncertainty(some(geometry.equations, *choose(geometry.equations, 40, criterion)), geometry.equations);
    EXPECT_LT(best.reading, 0.7 * plain.reading);
    EXPECT_LT(best.worst, 0.7 * plain.worst);
  }
  // Compliances, against a grid with the tool upright, as the source measures.
  const Candidates loads = *compliance_candidates(m, 400, 1, 250, 30e-6);
  const std::vector<Stand> upright = grid_stands(m, loads.stands, 15, 0);
  ASSERT_EQ(upright.size(), 15u);
  for (const Stand& stand : upright) EXPECT_TRUE(stand.X_MT.R.col(2).isApprox(Vec3::UnitZ()));
  const Uncertainty plain_loads = uncertainty(compliance_equations(m, upright, 250, 30e-6), loads.equations);
  for (const Criterion criterion : {Criterion::determinant, Criterion::reading}) {
    const Uncertainty best =
        uncertainty(some(loads.equations, *choose(loads.equations, 15, criterion)), loads.equations);
    EXPECT_LT(best.reading, 0.7 * plain_loads.reading);
    EXPECT_LT(best.worst, 0.7 * plain_loads.worst);
  }
  // The 15 points of one of the source's planes (SLAV 4.3) are worse still.
  std::vector<Stand> plane;
  for (int k = 0; k < 15; ++k) {
    Stand stand{{}, Pose{Mat3::Identity(), Vec3(-0.6 + 0.3 * (k % 5), -1.6 + 0.3 * (k / 5), 0)}};
    stand.q = kinematics::inverse(m, stand.X_MT).reachable()->joints;
    plane.push_back(stand);
  }
  const Uncertainty source = uncertainty(compliance_equations(m, plane, 250, 30e-6), loads.equations);
  const Uncertainty best =
      uncertainty(some(loads.equations, *choose(loads.equations, 15, Criterion::determinant)), loads.equations);
  EXPECT_LT(best.reading, 0.7 * source.reading);
  EXPECT_LT(best.mean, 0.7 * source.mean);
  EXPECT_LT(best.worst, 0.7 * source.worst);
}

TEST(Poses, WhatIsNoFiniteNumberIsNotChosenFrom) {
  for (const double force : {1e-200, 1e160, std::numeric_limits<double>::infinity()}) {
    const auto c = compliance_candidates(lola(), 40, 1, force, 30e-6);
    ASSERT_TRUE(c);
    const auto chosen = choose(c->equations, 12, Criterion::determinant);
    ASSERT_FALSE(chosen) << force;
    EXPECT_EQ(chosen.error().id, "CA130");
  }
}

TEST(Poses, EachCriterionIsBestAtItsOwn) {
  const Candidates c = *compliance_candidates(lola(), 300, 2, 250, 30e-6);
  const auto of = [&](Criterion criterion) {
    return uncertainty(some(c.equations, *choose(c.equations, 12, criterion)), c.equations);
  };
  const Uncertainty d = of(Criterion::determinant), e = of(Criterion::eigenvalue), v = of(Criterion::reading);
  EXPECT_LE(d.mean, std::min(e.mean, v.mean) * (1 + 1e-6));
  EXPECT_LE(e.worst, std::min(d.worst, v.worst) * (1 + 1e-6));
  EXPECT_LE(v.reading, std::min(d.reading, e.reading) * (1 + 1e-6));
}

// Every set of 3 out of 12 candidates stays above the bound, from whichever set it was computed, and near the best one
// it is tight.
TEST(Poses, NoSetComesBelowTheBound) {
  const Candidates c = *compliance_candidates(lola(), 12, 5, 250, 30e-6);
  double least = 1e300, bound = 0;
  for (std::size_t i = 0; i < 12; ++i)
    for (std::size_t j = 0; j < i; ++j)
      for (std::size_t k = 0; k < j; ++k) {
        least = std::min(least, uncertainty(some(c.equations, {i, j, k}), c.equations).mean);
        bound = std::max(bound, least_mean(c.equations, {i, j, k}));
      }
  EXPECT_LE(bound, least);
  EXPECT_GT(bound, 0.8 * least);
}

TEST(Poses, TheEigenvalueCriterionNeverLosesOnTheWorstDirection) {
  const Candidates c = *geometry_candidates(lola(), 200, 3, Kind::point, {}, {});
  const auto d = choose(c.equations, 30, Criterion::determinant), e = choose(c.equations, 30, Criterion::eigenvalue);
  EXPECT_LE(uncertainty(some(c.equations, *e), c.equations).worst,
            uncertainty(some(c.equations, *d), c.equations).worst * (1 + 1e-9));
  EXPECT_EQ(*d, *choose(c.equations, 30, Criterion::determinant));
}

TEST(Poses, WhatCannotBeIsNamed) {
  const Candidates c = *geometry_candidates(lola(), 50, 3, Kind::point, {}, {});
  EXPECT_EQ(choose(c.equations, 60, Criterion::determinant).error().id, "CA130");
  EXPECT_EQ(choose(c.equations, 5, Criterion::determinant).error().id, "CA130");
  EXPECT_EQ(compliance_candidates(*machine::load("hexapod-strut"), 10, 1, 250, 1e-6).error().id, "CA122");
  CalibrationOptions wrong;
  wrong.hold = {"elbow"};
  EXPECT_EQ(geometry_candidates(lola(), 10, 1, Kind::point, {}, wrong).error().id, "CA114");
}

}  // namespace
}  // namespace polypod::calibration
