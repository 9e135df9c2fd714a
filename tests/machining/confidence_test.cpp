// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How likely walls are inside, against draws of the uncertain inputs that go through the whole program.
#include "polypod/machining/confidence.hpp"

#include <random>

#include "examples.hpp"
#include "polypod/core/units.hpp"
#include "polypod/machining/uncertainty.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod {
namespace {

using machining::Confidence;
using testing::Example;
using testing::load_example;

constexpr std::array<double, 5> kSd{0.34e-7, 0.13e-7, 0.18e-7, 4.96e-7, 1.42e-7};  // rad/Nm, FACTS of the source

/// Independent standard deviations, `factor` times those of the identification.
Eigen::MatrixXd covariance(double factor) {
  Eigen::MatrixXd S = Eigen::MatrixXd::Zero(5, 5);
  for (int i = 0; i < 5; ++i) {
    S(i, i) = std::pow(factor * kSd[static_cast<std::size_t>(i)], 2);
  }
  return S;
}

Confidence confidence(const Example& e, const machining::Correction& c, const Eigen::MatrixXd& S) {
  return testing::unwrap(machining::confidence_of(e.job, e.program, c, S));
}

/// The normal error of every wall, and its largest distance, when the corrected program runs on another machine with
/// another material.
struct Runs {
  std::vector<machining::Spread> normal;
  std::vector<double> distance;
};
Runs run_on(const Example& e, const machining::Correction& c, const machine::AnyMachine& machine,
            const cutting::Material& material) {
  machining::Job job = e.job;
  job.machine = machine;
  job.material = material;
  cutting::Stock stock = job.stock;
  machining::PassOptions options;
  options.step = 0.1e-3;  // as the check of `correct`: the farthest errors lie in short ramps beside the corners
  Runs out{std::vector<machining::Spread>(e.interpretation.moves.size()),
           std::vector<double>(e.interpretation.moves.size(), 0.0)};
  testing::unwrap(machining::run_pass(
      job, c.program, machining::PassMoves(c.commanded), stock, options, [&](const machining::Sample& s) {
        if (!s.cutting || c.commanded[static_cast<std::size_t>(s.move)].transition || s.away.isZero(0)) return;
        const auto i = static_cast<std::size_t>(c.source[static_cast<std::size_t>(s.move)]);
        const gcode::Move& move = e.interpretation.moves[i];
        // The square is cut outside, clockwise or not: away from its centre leaves material.
        const Vec3 p = move.point(move.nearest(s.bent()));
        const Vec3 n = p.dot(s.away) > 0 ? s.away : Vec3(-s.away);
        out.normal[i].add((s.bent() - p).dot(n));
        out.distance[i] = std::max(out.distance[i], std::hypot((s.bent() - p).dot(n), s.bent().z() - p.z()));
      }));
  return out;
}

TEST(Confidence, AgainstDrawsThroughTheProgram) {
  // In exact path mode (G61) nothing is rounded at corners, and the whole tube is left.
  std::string text = testing::unwrap(files::read(testing::example_path("slavkovic_square", "program.ngc")));
  text.replace(text.find("G90 G94"), 3, "G90 G61");
  Example e = testing::with_program("slavkovic_square", text);
  e.job.step = 1e-3;
  const machining::Correction c = testing::correct(e);
  // So uncertain that walls are at risk, and every draw is still a compliance above 0.
  Eigen::MatrixXd S = covariance(1);
  S(0, 0) *= 100;
  S(1, 1) *= 400;
  S(2, 2) *= 400;
  S(3, 3) *= 4;
  S(4, 4) *= 100;
  const Confidence found = confidence(e, c, S);
  ASSERT_EQ(found.walls.size(), 4u);
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  constexpr int kDraws = 40;
  const std::vector<double> nominal = statics::column_compliances(e.job.machine);
  std::vector<int> inside(e.interpretation.moves.size(), 0);
  std::vector<machining::Spread> mean(e.interpretation.moves.size()), square(e.interpretation.moves.size());
  for (int draw = 0; draw < kDraws; ++draw) {
    std::vector<double> drawn = nominal;
    for (std::size_t i = 0; i < 5; ++i) drawn[i] = std::max(0.0, drawn[i] + std::sqrt(S(i, i)) * normal(random));
    const auto machine = testing::unwrap(statics::with_compliances(e.job.machine, drawn));
    const auto [walls, distance] = run_on(e, c, machine, e.job.material);
    for (std::size_t i = 0; i < walls.size(); ++i) {
      if (walls[i].count == 0) continue;
      mean[i].add(walls[i].mean);
      square[i].add(walls[i].mean * walls[i].mean);
      inside[i] += distance[i] <= e.job.tolerance ? 1 : 0;
    }
  }
  std::size_t w = 0;
  for (std::size_t i = 0; i < inside.size(); ++i) {
    if (mean[i].count == 0) continue;
    ASSERT_LT(w, found.walls.size());
    const double share = double(inside[i]) / kDraws;
    // The shift of the wall's mean scatters a little less than the point that shifts most; its sd is known to a ninth
    // from so many draws.
    const double sd = std::sqrt(square[i].mean - mean[i].mean * mean[i].mean);
    EXPECT_LT(sd, 1.3 * found.walls[w].sd) << "wall " << w;
    EXPECT_GT(sd, 0.6 * found.walls[w].sd) << "wall " << w;
    // Three standard deviations of a share of so many draws, and what the fed back force takes off.
    EXPECT_NEAR(found.walls[w].probability, share, 3 * std::sqrt(0.25 / kDraws) + 0.02) << "wall " << w;
    ++w;
  }
  EXPECT_EQ(w, 4u);
  EXPECT_LT(found.least, 0.999) << "the test says something only where walls are at risk";
}

TEST(Confidence, SdIsThatOfTheLinearModel) {
  const Example e = load_example("slavkovic_square");
  const machining::Correction c = testing::correct(e);
  const Confidence one = confidence(e, c, covariance(1)), two = confidence(e, c, covariance(2));
  // U (k = 2) of the band of the compliances, at its largest.
  const machining::ComplianceBand band = machining::compliance_band(e.job, c.after, covariance(1), &c.source);
  double largest = 0;
  for (std::size_t i = 0; i < one.walls.size(); ++i) {
    EXPECT_NEAR(two.walls[i].sd, 2 * one.walls[i].sd, 1e-12);
    largest = std::max(largest, one.walls[i].sd);
    EXPECT_LE(two.walls[i].probability, one.walls[i].probability + 1e-12);
    EXPECT_LE(one.walls[i].high, c.after.moves[i].normal.max + 1.96 * one.walls[i].sd + 1e-12);
    EXPECT_GT(one.walls[i].high, c.after.moves[i].normal.max);
  }
  // The band looks at 200 points of the program, the confidence at more of them.
  EXPECT_GE(largest, band.normal.max / 2 - 1e-9);
  EXPECT_LT(largest, 1.01 * band.normal.max / 2);
}

// The room of a wall is that of one point of it, across the path: with that point's error along the tool it lies on the
// surface of the tube. In exact path mode (G61) nothing is rounded at corners.
TEST(Confidence, RoomOfAWallIsWhatTheVerticalErrorLeavesOfTheTube) {
  std::string text = testing::unwrap(files::read(testing::example_path("slavkovic_square", "program.ngc")));
  text.replace(text.find("G90 G94"), 3, "G90 G61");
  const Example e = testing::with_program("slavkovic_square", text);
  const machining::Correction c = testing::correct(e);
  const Confidence found = confidence(e, c, covariance(1));
  ASSERT_EQ(found.walls.size(), 4U);
  std::vector<machining::Sample> samples;
  cutting::Stock stock = e.job.stock;
  machining::PassOptions options;
  options.step = 0.1e-3;  // as the check of `correct`
  testing::unwrap(machining::run_pass(e.job, c.program, machining::PassMoves(c.commanded), stock, options,
                                      [&](const machining::Sample& s) {
                                        if (s.cutting) samples.push_back(s);
                                      }));
  double highest = 0;
  for (const auto& wall : found.walls) {
    const auto m = std::find_if(c.after.moves.begin(), c.after.moves.end(),
                                [&](const machining::MovePrediction& move) { return move.line == wall.line; });
    ASSERT_NE(m, c.after.moves.end());
    const gcode::Move& move = e.interpretation.moves[static_cast<std::size_t>(m->move)];
    double nearest = 1;
    for (const machining::Sample& s : samples) {
      if (c.source[static_cast<std::size_t>(s.move)] != m->move || s.away.isZero(0)) continue;
      const double vertical = machining::path_error(move, s.bent(), s.away).vertical;
      nearest = std::min(nearest, std::abs(std::hypot(wall.room, vertical) - e.job.tolerance));
      highest = std::max(highest, std::abs(vertical));
    }
    EXPECT_LT(nearest, 1e-12) << "line " << wall.line;
  }
  EXPECT_GT(highest, 1e-6) << "the test says something only where the tool is off in height";
}

TEST(Confidence, SharesAndWhatToMeasure) {
  Example e = load_example("slavkovic_square");
  const machining::Correction c = testing::correct(e);
  Eigen::MatrixXd S = covariance(1);
  S(0, 0) *= 1e4;  // joint 1 is hardly known
  const Confidence found = confidence(e, c, S);
  EXPECT_EQ(found.inputs.front().name, "compliance of joint 1");
  EXPECT_GT(found.inputs.front().share, 0.9);
  double sum = 0;
  for (const auto& input : found.inputs) sum += input.share;
  EXPECT_NEAR(sum, 1, 1e-9);
  EXPECT_GE(found.inputs.front().least_if_halved, found.least);
  // Known twice as well: the same as a covariance with half of its sd.
  S(0, 0) /= 4;
  EXPECT_NEAR(confidence(e, c, S).least, found.inputs.front().least_if_halved, 1e-9);
}

TEST(Confidence, SpreadOfCoefficients) {
  Example e = load_example("slavkovic_square");
  const machining::Correction c = testing::correct(e);
  // All coefficients 10 % larger: the error is the deflection's change, about a tenth of 250 um less what a deflected
  // cutter takes.
  const cutting::Material& m = e.job.material;
  e.job.material.spread.push_back({0.1 * m.ktc, 0.1 * m.krc, 0.1 * m.kac, 0.1 * m.kte, 0.1 * m.kre, 0.1 * m.kae});
  const Confidence found = confidence(e, c, Eigen::MatrixXd(0, 0));
  ASSERT_EQ(found.inputs.size(), 1u);
  EXPECT_NEAR(found.inputs.front().share, 1, 1e-12);
  for (const auto& wall : found.walls) {
    EXPECT_GT(1.96 * wall.sd, 15e-6);
    EXPECT_LT(1.96 * wall.sd, 30e-6);
  }
}

TEST(Confidence, NothingUncertainIsCertain) {
  const Example e = load_example("slavkovic_square");
  const machining::Correction c = testing::correct(e);
  const Confidence found = confidence(e, c, Eigen::MatrixXd(0, 0));
  EXPECT_TRUE(found.inputs.empty());
  for (const auto& wall : found.walls) {
    EXPECT_EQ(wall.sd, 0);
    EXPECT_EQ(wall.probability, 1);
  }
}

}  // namespace
}  // namespace polypod
