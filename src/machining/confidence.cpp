// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/confidence.hpp"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <random>

#include "modes.hpp"
#include "polypod/machining/tilted.hpp"
#include "polypod/statics/compliance.hpp"
#include "way.hpp"

namespace polypod::machining {
namespace {

// Half of a 95 % interval in standard deviations.
constexpr double kHalf95 = 1.96;
// The step of `correct`'s check, m: what another step changes is no part of a variation.
constexpr double kCheckStep = 0.1e-3;

/// The coefficient whose change is the largest force, at a usual chip, by name.
std::string name_of(const std::array<double, 6>& variation) {
  constexpr double kUsualChip = 0.05e-3;  // m: K_c times it is a force a width, as K_e is
  constexpr std::array<const char*, 6> kNames{"Ktc", "Krc", "Kac", "Kte", "Kre", "Kae"};
  std::size_t most = 0;
  double largest = -1;
  int changed = 0;
  for (std::size_t i = 0; i < 6; ++i) {
    if (variation[i] != 0) ++changed;
    const double force = std::abs(variation[i]) * (i < 3 ? kUsualChip : 1);
    if (variation[i] == 0 || force <= largest) continue;
    largest = force;
    most = i;
  }
  return fmt::format("cutting coefficients, {}{}", changed > 1 ? "mostly " : "", kNames[most]);
}

/// A point of a wall: its error, what the tube leaves of it, and what each compliance shifts it by.
struct Point {
  double error = 0;
  double room = 0;
  Eigen::VectorXd lever;
  double vertical = 0;
  bool corner = false;  ///< stands for the farthest point of a block that ends at a corner, its side guessed
};

struct Wall {
  const MovePrediction* move = nullptr;
  std::vector<Point> points;
  std::vector<double> by_variation;  ///< m, sd of the shift of the whole wall by each variation of the coefficients
};

/// The same draws for every question, so that answers compare.
constexpr int kDraws = 4096;

/// Draws of the compliances and of the variations, a column each.
struct Draws {
  Eigen::MatrixXd compliances, variations;
};

Draws draws_of(const Eigen::MatrixXd& covariance, std::size_t variations) {
  std::mt19937_64 random(1);
  // Box and Muller: the library's own normal distribution differs from system to system.
  const auto uniform = [&] { return (static_cast<double>(random() >> 11) + 0.5) * 0x1p-53; };
  const auto normal = [&] { return std::sqrt(-2 * std::log(uniform())) * std::cos(2 * std::numbers::pi * uniform()); };
  Eigen::MatrixXd z(covariance.rows(), kDraws);
  Draws out{{}, Eigen::MatrixXd(static_cast<Eigen::Index>(variations), kDraws)};
  for (int d = 0; d < kDraws; ++d) {
    for (Eigen::Index k = 0; k < z.rows(); ++k) z(k, d) = normal();
    for (Eigen::Index v = 0; v < out.variations.rows(); ++v) out.variations(v, d) = normal();
  }
  if (covariance.rows() == 0) {
    out.compliances = z;
    return out;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(covariance);
  const Eigen::VectorXd sd = solver.eigenvalues().cwiseMax(0.0).cwiseSqrt();
  out.compliances = solver.eigenvectors() * sd.asDiagonal() * z;
  return out;
}

/// The share of draws with which all points of the wall are inside; `halved`: the input that is known twice as well,
/// compliances first; -1: none.
double probability_of(const Wall& wall, const Draws& draws, int halved) {
  const auto columns = static_cast<int>(draws.compliances.rows());
  Eigen::MatrixXd compliances = draws.compliances;
  if (halved >= 0 && halved < columns) compliances.row(halved) *= 0.5;
  Eigen::RowVectorXd shift = Eigen::RowVectorXd::Zero(kDraws);
  for (std::size_t v = 0; v < wall.by_variation.size(); ++v) {
    const double sd = wall.by_variation[v] * (columns + static_cast<int>(v) == halved ? 0.5 : 1.0);
    shift += sd * draws.variations.row(static_cast<Eigen::Index>(v));
  }
  Eigen::RowVectorXd left = Eigen::RowVectorXd::Constant(kDraws, 1e9);  // of the room
  for (const Point& point : wall.points) {
    Eigen::RowVectorXd error = shift.array() + point.error;
    if (columns > 0) error += point.lever.transpose() * compliances;
    left = left.cwiseMin((point.room - error.array().abs()).matrix());
  }
  return static_cast<double>((left.array() >= 0).count()) / kDraws;
}

}  // namespace

std::string Confidence::percent(double probability) const {
  // Of n draws of one kind 3/n are left open (95 %); between, the standard error is up to 0.8 % of 4096 draws.
  const double open = 3.0 / std::max(draws, 1);
  if (probability > 1 - open) return fmt::format("more than {:.1f} %", std::floor(1000 * (1 - open)) / 10);
  if (probability < open) return fmt::format("less than {:.1f} %", std::ceil(1000 * open) / 10);
  const double standard_error = std::sqrt(probability * (1 - probability) / draws);
  return fmt::format("{:.{}f} %", 100 * probability, standard_error < 2e-3 ? 1 : 0);
}

Result<Confidence> confidence_of(const Job& job, const gcode::Program& program, const Correction& correction,
                                 const Eigen::MatrixXd& covariance, const std::function<bool(double)>& progress) {
  const auto columns = static_cast<std::size_t>(covariance.rows());
  std::vector<std::string> names;
  if (columns > 0) {
    for (const std::string& column : statics::column_names(job.machine)) names.push_back("compliance of " + column);
  }
  for (const std::array<double, 6>& variation : job.material.spread) names.push_back(name_of(variation));

  std::vector<Wall> walls;
  std::vector<int> wall_of(correction.programmed.size(), -1);
  for (const MovePrediction& m : correction.after.moves) {
    if (m.normal.count == 0) continue;
    wall_of[static_cast<std::size_t>(m.move)] = static_cast<int>(walls.size());
    walls.push_back({&m, {}, std::vector<double>(job.material.spread.size(), 0.0)});
  }
  const Way way{&program, &correction.programmed, correction.commanded, correction.source};
  const Corners corners = corners_of(job, correction.program, way, correction.after, job.tolerance);
  const auto room_of = [&](double vertical, double corner) {
    const double tube = std::max(0.0, job.tolerance - corner);
    return std::sqrt(std::max(0.0, tube * tube - vertical * vertical));
  };
  std::vector<Eigen::VectorXd> all_levers;
  std::size_t seen = 0;
  for (const Sample& sample : correction.after.few) {
    if (progress && ++seen % 16 == 0 && !progress(0.2 * double(seen) / double(correction.after.few.size()))) {
      return fail("MC299", "cancelled");
    }
    if (sample.away.isZero(0)) continue;
    const int source = correction.source[static_cast<std::size_t>(sample.move)];
    const int w = wall_of[static_cast<std::size_t>(source)];
    if (w < 0) continue;
    Point point;
    const gcode::Move& move = correction.programmed[static_cast<std::size_t>(source)];
    const PathError error = path_error(move, sample.bent(), sample.away, job.tool_frame.axis());
    point.error = error.normal;
    point.vertical = is_plunge(move, job.tool_frame.axis()) ? 0 : error.vertical;
    point.room = room_of(point.vertical, corners.deviation[static_cast<std::size_t>(sample.move)]);
    if (columns > 0) {
      const Pose X_MT{cutting_orientation(job), job.X_MW * sample.command};
      const kinematics::InverseResult inverse = kinematics::inverse(job.machine, X_MT);
      const kinematics::Solution* solution = inverse.reachable();
      if (solution == nullptr) continue;
      const std::vector<Mat3> unit = statics::unit_compliances(job.machine, X_MT, solution->joints);
      const Vec3 F = job.X_MW.R * sample.force, n = job.X_MW.R * sample.away;
      point.lever.resize(static_cast<Eigen::Index>(columns));
      for (std::size_t k = 0; k < columns; ++k) point.lever[static_cast<Eigen::Index>(k)] = n.dot(unit[k] * F);
      all_levers.push_back(point.lever);
    }
    walls[static_cast<std::size_t>(w)].points.push_back(std::move(point));
  }
  const auto shifts_most = [&](const std::vector<Eigen::VectorXd>& levers) {
    return *std::max_element(levers.begin(), levers.end(), [&](const Eigen::VectorXd& a, const Eigen::VectorXd& b) {
      return a.dot(covariance * a) < b.dot(covariance * b);
    });
  };
  for (Wall& wall : walls) {
    // The farthest errors of the wall lie between its points: they go as the points do that are farthest of these. A
    // short move without a point goes as the one of all that goes most.
    const auto by_error = [](const Point& a, const Point& b) { return a.error < b.error; };
    const machining::MovePrediction& m = *wall.move;
    if (wall.points.empty()) {
      const Eigen::VectorXd lever =
          all_levers.empty() ? Eigen::VectorXd::Zero(static_cast<Eigen::Index>(columns)) : shifts_most(all_levers);
      const double vertical = std::max(std::abs(m.vertical.min), std::abs(m.vertical.max));
      for (const double error : {m.normal.min, m.normal.max})
        wall.points.push_back({error, room_of(vertical, 0), lever, vertical});
      continue;
    }
    Point lowest = *std::min_element(wall.points.begin(), wall.points.end(), by_error);
    Point highest = *std::max_element(wall.points.begin(), wall.points.end(), by_error);
    lowest.error = m.normal.min;
    highest.error = m.normal.max;
    for (Point* farthest : {&lowest, &highest}) {
      farthest->room = room_of(farthest->vertical, 0);  // its corner, if it has one, is looked at below
      wall.points.push_back(std::move(*farthest));
    }
  }
  // What the controller rounds counts with the whole of the block that ends there, as it does for the answer.
  for (std::size_t c = 0; c < correction.commanded.size(); ++c) {
    const int w = wall_of[static_cast<std::size_t>(correction.source[c])];
    if (w < 0 || !(corners.deviation[c] > 0)) continue;
    std::vector<Point>& points = walls[static_cast<std::size_t>(w)].points;
    Point point = *std::max_element(points.begin(), points.end(), [](const Point& a, const Point& b) {
      return std::abs(a.error) < std::abs(b.error);
    });
    point.error = std::copysign(correction.after.commanded_distance[c], point.error);
    point.room = room_of(0, corners.deviation[c]);
    point.corner = true;
    points.push_back(std::move(point));
  }

  // Every variation of the coefficients once through the corrected program.
  cutting::Stock scratch;
  for (std::size_t v = 0; v < job.material.spread.size(); ++v) {
    Job changed = job;
    changed.material = varied(job.material, job.material.spread[v]);
    PredictOptions options;
    options.step = std::min(job.step, kCheckStep);
    const double first = 0.2 + 0.8 * double(v) / double(job.material.spread.size());
    if (progress) {
      options.progress = [&, first](double share) {
        return progress(first + 0.8 * share / double(job.material.spread.size()));
      };
    }
    POLYPOD_ASSIGN(p, predict_way(changed, correction.program, way, options, scratch));
    std::vector<bool> found(walls.size(), false);
    for (const MovePrediction& move : p.moves) {
      const int w = wall_of[static_cast<std::size_t>(move.move)];
      if (w < 0 || move.normal.count == 0) continue;
      Wall& wall = walls[static_cast<std::size_t>(w)];
      wall.by_variation[v] = std::abs(move.normal.mean - wall.move->normal.mean) / kHalf95;
      found[static_cast<std::size_t>(w)] = std::isfinite(wall.by_variation[v]);
    }
    if (const auto lost = std::find(found.begin(), found.end(), false); lost != found.end()) {
      const Wall& wall = walls[static_cast<std::size_t>(lost - found.begin())];
      return fail(
          "MC310",
          fmt::format("with the {} changed by its spread_95, the prediction does not find this wall, so nothing can "
                      "be said of how likely it is inside",
                      name_of(job.material.spread[v])),
          {program.path, wall.move->line, 1}, "check spread_95 of the material: half of a 95 % interval");
    }
  }

  const Draws draws = draws_of(covariance, job.material.spread.size());
  Confidence out;
  out.draws = kDraws;
  std::vector<double> sums(names.size(), 0.0);
  double all = 0;
  for (const Wall& wall : walls) {
    WallConfidence w;
    w.line = wall.move->line;
    const Point& nearest = *std::min_element(
        wall.points.begin(), wall.points.end(),
        [](const Point& a, const Point& b) { return a.room - std::abs(a.error) < b.room - std::abs(b.error); });
    w.room = nearest.room;
    w.by_input.assign(names.size(), 0.0);
    w.low = w.high = wall.points.front().error;
    double of_variations = 0;
    for (const double sd : wall.by_variation) of_variations += sd * sd;
    double largest = -1;
    for (const Point& point : wall.points) {
      double variance = of_variations;
      Eigen::VectorXd Sg(0);
      if (columns > 0) {
        Sg = covariance * point.lever;
        variance += std::max(0.0, point.lever.dot(Sg));
      }
      const double sd = std::sqrt(variance);
      if (point.corner) continue;  // no other place of the wall
      w.low = std::min(w.low, point.error - kHalf95 * sd);
      w.high = std::max(w.high, point.error + kHalf95 * sd);
      if (variance <= largest) continue;
      largest = variance;
      w.sd = sd;
      for (std::size_t k = 0; k < columns; ++k) {
        w.by_input[k] = point.lever[static_cast<Eigen::Index>(k)] * Sg[static_cast<Eigen::Index>(k)];
      }
    }
    for (std::size_t v = 0; v < wall.by_variation.size(); ++v) {
      w.by_input[columns + v] = wall.by_variation[v] * wall.by_variation[v];
    }
    w.probability = probability_of(wall, draws, -1);
    if (out.walls.empty() || w.probability < out.least) {
      out.least = w.probability;
      out.line = w.line;
    }
    for (std::size_t k = 0; k < names.size(); ++k) sums[k] += w.by_input[k];
    all += w.sd * w.sd;
    out.walls.push_back(std::move(w));
  }
  for (std::size_t k = 0; k < names.size(); ++k) {
    double least = 1;
    for (const Wall& wall : walls) least = std::min(least, probability_of(wall, draws, static_cast<int>(k)));
    out.inputs.push_back({names[k], all > 0 ? sums[k] / all : 0, least});
  }
  std::stable_sort(out.inputs.begin(), out.inputs.end(),
                   [](const UncertainInput& a, const UncertainInput& b) { return a.share > b.share; });
  return out;
}

}  // namespace polypod::machining
