// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What covariances of compliances and of parameters mean for a program: against machines that are drawn from them, and
// over whole chains of measurement, identification and prediction.
#include "polypod/machining/uncertainty.hpp"

#include <gmock/gmock.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <map>

#include "machining/examples.hpp"
#include "polypod/core/random.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/by_parameters.hpp"
#include "polypod/statics/compliance.hpp"
#include "polypod/statics/identify.hpp"

namespace polypod {
namespace {

using testing::load_example;
using units::to_um;

/// The example on a workpiece that is turned, so that no normal lies along an axis of M.
testing::Example turned_example() {
  auto e = load_example("slavkovic_square");
  e.job.X_MW.R = rotation_z(units::from_deg(30));
  return e;
}

machining::Prediction at_rest(const testing::Example& e) {
  machining::PredictOptions options;
  options.bend = machining::Bend::at_rest;
  options.step = 5e-3;
  return testing::predict(e, options);
}

/// Readings under 250 N of the job's own machine round the work; normal noise in m.
std::vector<statics::MeasuredPoint> readings(const machining::Job& job, double noise, std::uint64_t seed) {
  Random random(seed);
  std::vector<statics::MeasuredPoint> out;
  for (const double z : {-300e-3, 0.0}) {
    for (int i = 0; i < 15; ++i) {
      statics::MeasuredPoint p;
      p.X_MT.p = Vec3(-0.6 + 0.3 * (i % 5), -1.6 + 0.3 * (i / 5), z);
      p.force = 250;
      p.displacement = statics::compliance_at(job.machine, p.X_MT).linear() * p.force;
      for (double& d : p.displacement.reshaped()) d += noise * random.normal();
      out.push_back(p);
    }
  }
  return out;
}

statics::Identification identified(const machining::Job& job, double noise, std::uint64_t seed) {
  return testing::unwrap(statics::identify_compliance(job.machine, readings(job, noise, seed)));
}

/// delta in W under the sample's force, by the compliance that the machine has.
Vec3 bend(const machining::Job& job, const machine::AnyMachine& m, const machining::Sample& s) {
  const Mat3 C = statics::compliance_at(m, {Mat3::Identity(), job.X_MW * s.command}).linear();
  return job.X_MW.R.transpose() * (C * (job.X_MW.R * s.force));
}

// 3000 machines a point are drawn from the covariance, their bends computed by the whole compliance: standard
// deviations are known to 1.3 %, the longer of two axes lies a little higher; four of these.
TEST(Uncertainty, TheBandIsWhatDrawnCompliancesScatterBy) {
  constexpr int kDraws = 3000;
  constexpr double kSlack = 0.052;
  const auto e = turned_example();
  const auto p = at_rest(e);
  const auto r = identified(e.job, 40e-6, 3);
  const Eigen::MatrixXd L = r.covariance.llt().matrixL();
  const std::vector<double> c = statics::column_compliances(e.job.machine);
  for (const std::size_t at : {p.few.size() / 8, p.few.size() / 3, p.few.size() - 3}) {
    const machining::Sample& s = p.few[at];
    machining::Prediction one;
    one.few = {s};
    const machining::ComplianceBand band = machining::compliance_band(e.job, one, r.covariance);
    ASSERT_EQ(band.normal.count, 1u);
    Random random(5);
    Eigen::MatrixXd off(2, kDraws);  // along the normal and along the tool axis
    const Vec3 nominal = bend(e.job, e.job.machine, s);
    for (int i = 0; i < kDraws; ++i) {
      Eigen::VectorXd z(L.cols());
      for (double& x : z) x = random.normal();
      const Eigen::VectorXd dc = L * z;
      std::vector<double> drawn = c;
      for (std::size_t k = 0; k < drawn.size(); ++k) drawn[k] += dc[Eigen::Index(k)];
      const Vec3 d = bend(e.job, testing::unwrap(statics::with_compliances(e.job.machine, drawn)), s) - nominal;
      off.col(i) << s.away.dot(d), d.z();
    }
    const Eigen::Matrix2d S = off * off.transpose() / kDraws;
    EXPECT_NEAR(band.normal.max / (2 * std::sqrt(S(0, 0))), 1, kSlack) << at;
    const double longest = Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(S).eigenvalues()[1];
    EXPECT_NEAR(band.across.max / (2 * std::sqrt(longest)), 1, kSlack) << at;
    EXPECT_GE(band.across.max, band.normal.max * (1 - 1e-12));
  }
}

// 60 times: displacements with noise are measured on a machine, its compliances identified, and the program predicted
// with them and their covariance. The normal error that the machine really has lies within U (k = 2) for 95.4 % of the
// points; those of one measurement hang together, so that 60 know the share to 3 %. Three of these.
TEST(Uncertainty, TheTruthLiesInTheBandOfAWholeChain) {
  constexpr int kChains = 60;
  constexpr double kNoise = 20e-6, kSlack = 0.085;
  const auto truth = turned_example();
  const auto real = at_rest(truth);
  double inside = 0, all = 0, square = 0;
  for (int chain = 0; chain < kChains; ++chain) {
    const auto r = identified(truth.job, kNoise, 100 + std::uint64_t(chain));
    auto e = truth;
    e.job.machine = testing::unwrap(statics::with_compliances(truth.job.machine, r.compliance));
    // At rest the forces are those at the commanded points: one pass tells them for all machines.
    if (chain == 0) {
      const auto p = at_rest(e);
      ASSERT_EQ(p.few.size(), real.few.size());
      for (std::size_t i = 0; i < p.few.size(); i += 9)
        EXPECT_NEAR((p.few[i].deflection - bend(e.job, e.job.machine, real.few[i])).norm(), 0, 1e-9);
    }
    for (std::size_t i = 2; i < real.few.size(); i += 10) {
      const machining::Sample& s = real.few[i];
      machining::Prediction one;
      one.few = {s};
      const double U = machining::compliance_band(e.job, one, r.covariance).normal.max;
      const double off = s.away.dot(bend(e.job, e.job.machine, s) - s.deflection);
      inside += std::abs(off) <= U ? 1 : 0;
      square += std::pow(off / (U / 2), 2);
      ++all;
    }
  }
  RecordProperty("inside_percent", std::to_string(100 * inside / all));
  EXPECT_NEAR(inside / all, 0.954, kSlack);
  EXPECT_NEAR(std::sqrt(square / all), 1, 0.15);  // 60 of five numbers that hang together
}

// The band of a program is that of its points, and each move has the largest of its own.
TEST(Uncertainty, BandsOfMovesAreThoseOfTheirPoints) {
  const auto e = turned_example();
  const auto p = at_rest(e);
  const auto r = identified(e.job, 20e-6, 1);
  const auto band = machining::compliance_band(e.job, p, r.covariance);
  ASSERT_EQ(band.by_move.size(), p.moves.size());
  EXPECT_EQ(band.normal.count, p.few.size());
  std::vector<double> largest(p.moves.size(), 0);
  for (const machining::Sample& s : p.few) {
    machining::Prediction one;
    one.few = {s};
    const double U = machining::compliance_band(e.job, one, r.covariance).across.max;
    for (std::size_t i = 0; i < p.moves.size(); ++i)
      if (p.moves[i].move == s.move) largest[i] = std::max(largest[i], U);
  }
  for (std::size_t i = 0; i < largest.size(); ++i) {
    EXPECT_GT(largest[i], 0);
    EXPECT_DOUBLE_EQ(band.by_move[i], largest[i]);
  }
  // Where few points stand for many moves, one without a point takes the largest of all.
  auto few = p;
  few.few = {p.few.front()};
  const auto sparse = machining::compliance_band(e.job, few, r.covariance);
  for (const double U : sparse.by_move) EXPECT_EQ(U, sparse.across.max);
}

// A corrected program stays inside the tube by the compliances as identified. With U it does where there is room, and
// the farthest move is named where there is none; the answer without U is the same.
TEST(Uncertainty, AYesIsWeighedWithU) {
  const auto e = load_example("slavkovic_square");
  const auto r = identified(e.job, 20e-6, 1);
  const auto c = testing::correct(e);
  ASSERT_TRUE(c.within_tolerance);
  for (const double times : {1e-6, 1.0, 3.0, 30.0}) {
    SCOPED_TRACE(times);
    const Eigen::MatrixXd covariance = times * times * r.covariance;
    const auto u = machining::uncertainty_of(e.job, c, &covariance, nullptr);
    ASSERT_TRUE(u.compliances && u.reach);
    EXPECT_FALSE(u.place);
    const auto& reach = *u.reach;
    EXPECT_EQ(reach.within, reach.total() <= e.job.tolerance);
    // No point that was looked at comes farther, and the named move is one that comes as far.
    for (const machining::Sample& s : c.after.few) {
      machining::Prediction one;
      one.few = {s};
      const double U = machining::compliance_band(e.job, one, covariance).across.max;
      EXPECT_LE(s.distance + U, reach.total() + 1e-9);
    }
    bool named = false;
    for (const machining::MoveOutcome& m : c.moves)
      named = named || (m.line == reach.line && reach.distance <= m.distance_after + m.corner_after + 1e-12);
    EXPECT_TRUE(named);
    EXPECT_LE(reach.distance, c.largest_after + 1e-12);
  }
  const Eigen::MatrixXd tiny = 1e-12 * r.covariance, wide = 1e4 * r.covariance;
  EXPECT_TRUE(machining::uncertainty_of(e.job, c, &tiny, nullptr).reach->within);
  EXPECT_FALSE(machining::uncertainty_of(e.job, c, &wide, nullptr).reach->within);
  auto outside = c;
  outside.within_tolerance = false;
  EXPECT_FALSE(machining::uncertainty_of(e.job, outside, &tiny, nullptr).reach->within);
  // The program as it is leaves the tube.
  const auto p = testing::predict(e);
  EXPECT_FALSE(machining::uncertainty_of(e.job, p, &tiny, nullptr).reach->within);
  auto roomy = e;
  roomy.job.tolerance = 1e-3;
  EXPECT_TRUE(machining::uncertainty_of(roomy.job, p, &tiny, nullptr).reach->within);
  EXPECT_FALSE(machining::uncertainty_of(roomy.job, p, &wide, nullptr).reach->within);
  EXPECT_FALSE(machining::uncertainty_of(e.job, p, nullptr, nullptr).reach);
}

// One link's length is uncertain: the tip's place is, by as much as the tip moves when the link is that much longer.
TEST(Uncertainty, TheMachinesPlaceIsThatOfItsParameters) {
  const auto e = load_example("slavkovic_square");
  const auto p = at_rest(e);
  const std::vector<machine::Parameter> all = kinematics::parameters(e.job.machine);
  constexpr double kDeviation = 30e-6, kStep = 1e-6;
  bool told_apart = false;
  for (std::size_t k = 0; k < all.size(); ++k) {
    if (all[k].unit != "mm" && all[k].unit != "deg") continue;
    Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(std::ssize(all), std::ssize(all));
    covariance(Eigen::Index(k), Eigen::Index(k)) = kDeviation * kDeviation;
    const auto u = machining::uncertainty_of(e.job, p, nullptr, &covariance);
    ASSERT_TRUE(u.place);
    EXPECT_EQ(u.place->tip.count, p.few.size());
    std::map<int, double> on_line;
    for (const machining::Sample& s : p.few) {
      const Pose X{Mat3::Identity(), e.job.X_MW * s.command};
      const machine::JointVector q = kinematics::inverse(e.job.machine, X).reachable()->joints;
      std::vector<double> values;
      for (const machine::Parameter& one : all) values.push_back(one.value);
      values[k] += kStep;
      const auto longer = testing::unwrap(machine::with_parameters(e.job.machine, values));
      const auto tip = [&](const machine::AnyMachine& m) { return kinematics::forward(m, q).poses.front().p; };
      const double U = 2 * kDeviation * (tip(longer) - tip(e.job.machine)).norm() / kStep;
      for (const machining::MovePrediction& m : p.moves)
        if (m.move == s.move) on_line[m.line] = std::max(on_line[m.line], U);
    }
    double largest = 0;
    for (const auto& [line, U] : on_line) largest = std::max(largest, U);
    EXPECT_NEAR(u.place->tip.max, largest, 1e-5 * largest + 1e-12) << all[k].key;
    EXPECT_NEAR(on_line[u.place->line], largest, 1e-5 * largest + 1e-12) << all[k].key;
    for (const auto& [line, U] : on_line) told_apart = told_apart || U < 0.999 * largest;
  }
  EXPECT_TRUE(told_apart) << "any line would have done";
}

}  // namespace
}  // namespace polypod
