// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/confidence.hpp"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <random>

#include "few.hpp"
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

/// A point of a wall: its error across the path and along the tool, the tube that the controller's corner leaves, and
/// what each compliance shifts it by, both ways.
struct Point {
  double error = 0, vertical = 0, tube = 0;
  Eigen::VectorXd lever, lever_up;
  bool corner = false;  ///< stands for the farthest point of a block that ends at a corner, its side guessed
  double across = 0;    ///< of such a point what of its distance lies across the path, about

  /// What the tube leaves across the path.
  [[nodiscard]] double room() const {
    const double along_tool = corner ? std::max(0.0, error * error - across * across) : vertical * vertical;
    return std::sqrt(std::max(0.0, tube * tube - along_tool));
  }
  /// What is left of the tube; negative: outside.
  [[nodiscard]] double left() const { return corner ? tube - std::abs(error) : room() - std::abs(error); }
};

/// The points of a wall that stand for all of it: some at equal distances, and the farthest both ways.
class Standing {
 public:
  Standing(const MovePrediction& m, std::size_t evenly) : move(&m), evenly_(evenly) {}
  void add(const Sample& sample, const PathError& error) {
    evenly_.add(sample);
    const std::array<double, 5> far{-error.normal, error.normal, -error.vertical, error.vertical, error.distance};
    for (std::size_t k = 0; k < far.size(); ++k) {
      if (any_ && !(far[k] > far_[k])) continue;
      far_[k] = far[k];
      farthest_[k] = sample;
    }
    any_ = true;
  }
  std::vector<Sample> evenly() { return evenly_.take(); }
  [[nodiscard]] std::vector<Sample> farthest() const {
    return any_ ? std::vector<Sample>(farthest_.begin(), farthest_.end()) : std::vector<Sample>{};
  }
  /// 1 where the prediction counts normal errors to the left of the feed, as samples do; -1: to the right.
  [[nodiscard]] double side() const {
    const double low = -far_[0], high = far_[1];
    const double left = std::abs(low - move->normal.min) + std::abs(high - move->normal.max);
    const double right = std::abs(-high - move->normal.min) + std::abs(-low - move->normal.max);
    return left <= right ? 1 : -1;
  }
  const MovePrediction* move;

 private:
  Few evenly_;
  std::array<double, 5> far_{};
  std::array<Sample, 5> farthest_;
  bool any_ = false;
};

struct Wall {
  const MovePrediction* move = nullptr;
  std::vector<Point> points;
  /// m, the shift of the whole wall by one sd of each variation of the coefficients, across the path and along the tool
  std::vector<double> by_variation, by_variation_up;
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
  Eigen::RowVectorXd shift = Eigen::RowVectorXd::Zero(kDraws), shift_up = shift;
  for (std::size_t v = 0; v < wall.by_variation.size(); ++v) {
    const double known = columns + static_cast<int>(v) == halved ? 0.5 : 1.0;
    const auto drawn = draws.variations.row(static_cast<Eigen::Index>(v));
    shift += known * wall.by_variation[v] * drawn;
    shift_up += known * wall.by_variation_up[v] * drawn;
  }
  Eigen::RowVectorXd left = Eigen::RowVectorXd::Constant(kDraws, 1e9);  // of the tube
  for (const Point& point : wall.points) {
    Eigen::RowVectorXd error = shift.array() + point.error, vertical = shift_up.array() + point.vertical;
    if (columns > 0) {
      error += point.lever.transpose() * compliances;
      vertical += point.lever_up.transpose() * compliances;
    }
    left = left.cwiseMin((point.tube - (error.array().square() + vertical.array().square()).sqrt()).matrix());
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

Status force_is_known(const Job& job) {
  double half_95 = 0;
  for (const std::array<double, 6>& variation : job.material.spread) half_95 = std::hypot(half_95, variation[0]);
  if (half_95 < job.material.ktc || half_95 == 0) return {};
  const double percent = 100 * half_95 / job.material.ktc;
  return fail(
      "MC311",
      fmt::format("the tangential cutting coefficient is {}: it might be 0 or below, and nothing can be said of what "
                  "that does",
                  std::isfinite(percent) ? fmt::format("said to within {:.3g} % (95 %)", percent) : "0 itself"),
      {job.path, 0, 0},
      "check spread_95 of the material (half of 95 % intervals) and force_uncertainty, or measure the forces");
}

Result<Confidence> confidence_of(const Job& job, const gcode::Program& program, const Correction& correction,
                                 const Eigen::MatrixXd& covariance, const std::function<bool(double)>& progress) {
  POLYPOD_TRY(force_is_known(job));
  const auto columns = static_cast<std::size_t>(covariance.rows());
  std::vector<std::string> names;
  if (columns > 0) {
    for (const std::string& column : statics::column_names(job.machine)) names.push_back("compliance of " + column);
  }
  for (const std::array<double, 6>& variation : job.material.spread) names.push_back(name_of(variation));

  std::vector<Wall> walls;
  std::vector<Standing> standing;
  std::vector<int> wall_of(correction.programmed.size(), -1);
  const auto cut = std::count_if(correction.after.moves.begin(), correction.after.moves.end(),
                                 [](const MovePrediction& m) { return m.normal.count > 0; });
  constexpr std::size_t kEvenly = 4000, kMostEvenly = 40;  // of all walls, and of one
  const std::size_t evenly =
      std::clamp<std::size_t>(kEvenly / std::max<std::size_t>(1, std::size_t(cut)), 2, kMostEvenly);
  for (const MovePrediction& m : correction.after.moves) {
    if (m.normal.count == 0) continue;
    wall_of[static_cast<std::size_t>(m.move)] = static_cast<int>(walls.size());
    const std::vector<double> none(job.material.spread.size(), 0.0);
    walls.push_back({&m, {}, none, none});
    standing.emplace_back(m, evenly / 2 * 2);
  }
  const Way way{&program, &correction.programmed, correction.commanded, correction.source};
  const Corners corners = corners_of(job, correction.program, way, correction.after, job.tolerance);
  const auto tube_beside = [&](double corner) { return std::max(0.0, job.tolerance - corner); };
  const Vec3 up = job.tool_frame.axis();
  const auto error_from = [&](const gcode::Move& move, const Sample& s) {
    return path_error(move, s.bent() + middle_beside_tip(job, move, s.bent(), s.axes), s.away, up);
  };

  // The corrected program once more, for the points that `after` has not kept.
  const double passes = 1.2 + double(job.material.spread.size());
  const auto share_of_pass = [&](double begun) {
    return progress ? std::function<bool(double)>(
                          [&progress, begun, passes](double share) { return progress((begun + share) / passes); })
                    : std::function<bool(double)>();
  };
  cutting::Stock scratch = job.stock;
  PassOptions pass;
  pass.step = std::min(job.step, kCheckStep);
  pass.progress = share_of_pass(0);
  POLYPOD_TRY(run_pass(job, correction.program, PassMoves(correction.commanded), scratch, pass, [&](const Sample& s) {
    if (!s.cutting || correction.commanded[static_cast<std::size_t>(s.move)].transition || s.away.isZero(0)) return;
    const int source = correction.source[static_cast<std::size_t>(s.move)];
    const int w = wall_of[static_cast<std::size_t>(source)];
    if (w < 0) return;
    const gcode::Move& move = correction.programmed[static_cast<std::size_t>(source)];
    standing[static_cast<std::size_t>(w)].add(s, error_from(move, s));
  }));
  for (std::size_t w = 0; w < walls.size(); ++w) {
    if (progress && w % 64 == 0 && !progress((1 + 0.2 * double(w) / double(walls.size())) / passes))
      return fail("MC299", "cancelled");
    const gcode::Move& move = correction.programmed[static_cast<std::size_t>(walls[w].move->move)];
    const bool plunges = is_plunge(move, up);  // what a plunge is held back by along the tool does not count
    const double side = standing[w].side();
    const auto stand = [&](const Sample& sample, double corner) {
      const PathError error = error_from(move, sample);
      Point point;
      point.error = side * error.normal;
      point.vertical = plunges ? 0 : error.vertical;
      point.tube = tube_beside(corner);
      if (columns > 0) {
        const Pose X_MT{cutting_orientation(job, sample.axes), job.X_MW * sample.command};
        const std::optional<machine::JointVector> q = joints_at(job, X_MT, sample);
        if (!q) return;
        const std::vector<Mat3> unit = statics::unit_compliances(job.machine, X_MT, *q);
        const Vec3 F = job.X_MW.R * sample.force, n = job.X_MW.R * (side * sample.away);
        const Vec3 along_tool = plunges ? Vec3::Zero() : Vec3(job.X_MW.R * up);
        point.lever.resize(static_cast<Eigen::Index>(columns));
        point.lever_up.resize(static_cast<Eigen::Index>(columns));
        for (std::size_t k = 0; k < columns; ++k) {
          const Vec3 shift = unit[k] * F;
          point.lever[static_cast<Eigen::Index>(k)] = n.dot(shift);
          point.lever_up[static_cast<Eigen::Index>(k)] = along_tool.dot(shift);
        }
      }
      walls[w].points.push_back(std::move(point));
    };
    for (const Sample& sample : standing[w].evenly())
      stand(sample, corners.deviation[static_cast<std::size_t>(sample.move)]);
    for (const Sample& sample : standing[w].farthest()) stand(sample, 0);  // a corner is looked at below
    if (walls[w].points.empty()) {
      return fail("MC310",
                  "the prediction does not find this wall again, so nothing can be said of how likely it is inside",
                  {program.path, walls[w].move->line, 1}, "give a smaller step_mm in the job");
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
    point.across = point.error;
    point.error = std::copysign(correction.after.commanded_distance[c], point.error);
    point.vertical = 0;  // in the distance
    point.tube = tube_beside(corners.deviation[c]);
    point.corner = true;
    points.push_back(std::move(point));
  }

  // Every variation of the coefficients once through the corrected program.
  for (std::size_t v = 0; v < job.material.spread.size(); ++v) {
    Job changed = job;
    changed.material = varied(job.material, job.material.spread[v]);
    PredictOptions options;
    options.step = pass.step;
    options.progress = share_of_pass(1.2 + double(v));
    POLYPOD_ASSIGN(p, predict_way(changed, correction.program, way, options, scratch));
    std::vector<bool> found(walls.size(), false);
    for (const MovePrediction& move : p.moves) {
      const int w = wall_of[static_cast<std::size_t>(move.move)];
      if (w < 0 || move.normal.count == 0) continue;
      Wall& wall = walls[static_cast<std::size_t>(w)];
      wall.by_variation[v] = (move.normal.mean - wall.move->normal.mean) / kHalf95;
      if (!is_plunge(correction.programmed[static_cast<std::size_t>(move.move)], up))
        wall.by_variation_up[v] = (move.vertical.mean - wall.move->vertical.mean) / kHalf95;
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
    const Point& nearest = *std::min_element(wall.points.begin(), wall.points.end(),
                                             [](const Point& a, const Point& b) { return a.left() < b.left(); });
    w.room = nearest.room();
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
