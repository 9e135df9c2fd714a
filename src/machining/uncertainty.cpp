// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/uncertainty.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "polypod/kinematics/by_parameters.hpp"
#include "polypod/machining/tilted.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod::machining {
namespace {

using kinematics::kCoverageFactor;
using kinematics::largest_deviation;

/// Index into the moves of the program.
int programmed_of(const Sample& sample, const LongVector<int>* source) {
  return source == nullptr ? sample.move : (*source)[static_cast<std::size_t>(sample.move)];
}

/// What is left of a displacement in W across the path; `axis` is that of the tool.
Mat3 across_path(const Sample& sample, const Vec3& axis) {
  if (sample.away.isZero(0)) return Mat3::Identity();
  return sample.away * sample.away.transpose() + axis * axis.transpose();
}

void take(Reach& farthest, int line, double distance, double U) {
  if (distance + U <= farthest.total()) return;
  farthest.line = line;
  farthest.distance = distance;
  farthest.U = U;
}

/// The program with the other position of block delete, whose moves are not told apart; line 0.
void take_other(Reach& farthest, const std::optional<OtherSwitch>& other, const ComplianceBand& band) {
  if (other) take(farthest, 0, other->distance_after, band.across.max);
}

}  // namespace

ComplianceBand compliance_band(const Job& job, const Prediction& prediction, const Eigen::MatrixXd& covariance,
                               const LongVector<int>* source) {
  ComplianceBand out;
  std::vector<double> of_move;  // by index into the moves of the program; below 0: no point on it
  for (const Sample& sample : prediction.few) {
    const Pose X_MT{cutting_orientation(job, sample.axes), job.X_MW * sample.command};
    const auto q = joints_at(job, X_MT, sample);
    if (!q) continue;
    const std::vector<Mat3> unit = statics::unit_compliances(job.machine, X_MT, *q);
    Eigen::Matrix<double, 3, Eigen::Dynamic> G(3, std::ssize(unit));  // delta in W by each compliance
    for (std::size_t k = 0; k < unit.size(); ++k)
      G.col(static_cast<Eigen::Index>(k)) = job.X_MW.R.transpose() * (unit[k] * (job.X_MW.R * sample.force));
    const Mat3 of_delta = G * covariance * G.transpose(), P = across_path(sample, job.tool_frame.axis());
    if (!sample.away.isZero(0))
      out.normal.add(kCoverageFactor * std::sqrt(std::max(0.0, sample.away.dot(of_delta * sample.away))));
    const double across = kCoverageFactor * largest_deviation(P * of_delta * P);
    out.across.add(across);
    const auto move = static_cast<std::size_t>(programmed_of(sample, source));
    if (of_move.size() <= move) of_move.resize(move + 1, -1.0);
    of_move[move] = std::max(of_move[move], across);
  }
  for (const MovePrediction& m : prediction.moves) {
    const auto move = static_cast<std::size_t>(m.move);
    const bool seen = move < of_move.size() && of_move[move] >= 0;
    out.by_move.push_back(seen ? of_move[move] : out.across.max);
  }
  return out;
}

PlaceBand place_band(const Job& job, const Prediction& prediction, const Eigen::MatrixXd& covariance,
                     const LongVector<int>* source) {
  PlaceBand out;
  int farthest = -1;
  for (const Sample& sample : prediction.few) {
    const Pose X_MT{cutting_orientation(job, sample.axes), job.X_MW * sample.command};
    const auto q = joints_at(job, X_MT, sample);
    if (!q) continue;
    const double U = kCoverageFactor * largest_deviation(kinematics::tip_covariance(job.machine, X_MT, *q, covariance));
    if (farthest < 0 || U > out.tip.max) farthest = programmed_of(sample, source);
    out.tip.add(U);
  }
  for (const MovePrediction& m : prediction.moves)
    if (m.move == farthest) out.line = m.line;
  return out;
}

std::string Reach::where() const {
  return line > 0 ? fmt::format("at line {}", line) : "with the other position of block delete";
}

Uncertainty uncertainty_of(const Job& job, const Prediction& prediction, const Eigen::MatrixXd* compliances,
                           const Eigen::MatrixXd* parameters) {
  Uncertainty out;
  if (prediction.few.empty()) return out;
  if (parameters != nullptr) out.place = place_band(job, prediction, *parameters);
  if (compliances == nullptr) return out;
  out.compliances = compliance_band(job, prediction, *compliances);
  Reach& reach = out.reach.emplace();
  // Which corner is rounded by how much is not kept of a prediction: none by more than the worst.
  for (std::size_t i = 0; i < prediction.moves.size(); ++i) {
    const MovePrediction& m = prediction.moves[i];
    take(reach, m.line, std::min(m.largest_distance + prediction.corner, prediction.largest_with_corners),
         out.compliances->by_move[i]);
  }
  take_other(reach, prediction.other_switch, *out.compliances);
  reach.within = prediction.within(job) && reach.total() <= job.tolerance;
  return out;
}

Uncertainty uncertainty_of(const Job& job, const Correction& c, const Eigen::MatrixXd* compliances,
                           const Eigen::MatrixXd* parameters) {
  Uncertainty out;
  if (c.after.few.empty()) return out;
  if (parameters != nullptr) out.place = place_band(job, c.after, *parameters, &c.source);
  if (compliances == nullptr) return out;
  out.compliances = compliance_band(job, c.after, *compliances, &c.source);
  Reach& reach = out.reach.emplace();
  std::size_t next = 0;  // both lists rise with the moves of the program
  for (const MoveOutcome& m : c.moves) {
    while (next < c.after.moves.size() && c.after.moves[next].move < m.move) ++next;
    const bool cuts = next < c.after.moves.size() && c.after.moves[next].move == m.move;
    take(reach, m.line, std::min(m.distance_after + m.corner_after, c.largest_after),
         cuts ? out.compliances->by_move[next] : 0.0);
  }
  take_other(reach, c.other_switch, *out.compliances);
  reach.within = c.within_tolerance && reach.total() <= c.tolerance;
  return out;
}

}  // namespace polypod::machining
