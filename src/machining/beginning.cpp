// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/beginning.hpp"

#include <algorithm>
#include <cmath>
#include <functional>

#include "polypod/machining/tilted.hpp"

namespace polypod::machining {
namespace {

constexpr double kStep = 5e-3, kTurnStep = 0.0175;  // m, rad

kinematics::WayPiece piece_of(const machine::AnyMachine& machine, const Pose& X_MW, const gcode::Move& move) {
  const auto pose_at = [&machine, &X_MW, &move](double share) {
    const Vec3 axes = move.axes_start + share * (move.axes_end - move.axes_start);
    return Pose{tool_orientation(machine, X_MW, axes), X_MW * move.point(move.length() * share)};
  };
  if (!move.start_known) return {[pose_at](double) { return pose_at(1); }, 1};
  const double turn = (move.axes_end - move.axes_start).cwiseAbs().maxCoeff();
  const double steps = std::ceil(std::max(move.length() / kStep, turn / kTurnStep));
  constexpr double kMostSteps = 1e5;
  return {pose_at, static_cast<int>(std::clamp(steps, 1.0, kMostSteps))};
}

/// The moves from the first place that is known to the next one that is not, as pieces of a way.
std::function<std::optional<kinematics::WayPiece>()> way_of(const machine::AnyMachine& machine, const Pose& X_MW,
                                                            const gcode::Interpretation& interpretation) {
  const auto& moves = interpretation.moves;
  const auto is_placed = [](const gcode::Move& m) {
    return std::all_of(m.known_end.begin(), m.known_end.end(), [](bool known) { return known; });
  };
  return [&machine, &X_MW, &moves, is_placed, at = std::find_if(moves.begin(), moves.end(), is_placed),
          first = true]() mutable -> std::optional<kinematics::WayPiece> {
    if (at == moves.end() || !is_placed(*at) || !(first || at->start_known)) return std::nullopt;
    first = false;
    return piece_of(machine, X_MW, *at++);
  };
}

}  // namespace

std::optional<kinematics::Beginning> look_ahead(const machine::AnyMachine& machine, const Pose& X_MW,
                                                const gcode::Interpretation& interpretation,
                                                const std::string& posture) {
  return kinematics::look_ahead(machine, way_of(machine, X_MW, interpretation), posture);
}

std::string choose_start(const gcode::Interpretation& interpretation, Job& job) {
  if (!job.start_joints.empty()) {
    const Eigen::Map<const Eigen::VectorXd> start(job.start_joints.data(), std::ssize(job.start_joints));
    if (job.own_posture) return {};
    std::string name = kinematics::posture_behind(job.machine, way_of(job.machine, job.X_MW, interpretation), start);
    if (!name.empty()) job.posture = std::move(name);
    return {};
  }
  const auto beginning = look_ahead(job.machine, job.X_MW, interpretation, job.posture);
  if (!beginning) return {};
  job.start_joints.assign(beginning->joints.begin(), beginning->joints.end());
  if (!beginning->posture.empty()) job.posture = beginning->posture;
  return kinematics::in_words(job.machine, *beginning);
}

}  // namespace polypod::machining
