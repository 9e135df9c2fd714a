// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "singular_inside.hpp"

#include <algorithm>
#include <cmath>

#include "polypod/core/parallel.hpp"
#include "polypod/kinematics/hold.hpp"
#include "polypod/workspace/task_directions.hpp"

namespace polypod::quality {
namespace {

constexpr std::size_t kMostPoses = 200'000;

/// Of a machine, at poses of the survey's task.
class HoldAtTask {
 public:
  HoldAtTask(const AnyMachine& machine, int side) : machine_(machine), hold_(machine), side_(side) {}
  /// Nothing where it has no joints; `control` exact below kZero.
  [[nodiscard]] std::optional<kinematics::Hold> at(const Pose& X) const {
    return workspace::reached_on_side(machine_, hold_, X, side_, ~kinematics::LimitBits{0}, kZero);
  }
  static constexpr double kZero = 1e-7;  // what bisection of rounded numbers leaves of `control`

 private:
  const AnyMachine& machine_;
  kinematics::HoldAnywhere hold_;
  int side_;
};

/// The singular pose between two points of one orientation whose determinants have other signs.
std::optional<Pose> bisected(const AnyMachine& machine, const HoldAtTask& hold, const SurveyOptions& options,
                             const machine::Task& task, const Mat3& R, Vec3 a, Vec3 b, double sign_at_a) {
  constexpr int kHalvings = 60;
  for (int k = 0; k < kHalvings; ++k) {
    const Vec3 between = 0.5 * (a + b);
    if (!workspace::reaches_samples(machine, options.workspace, {R}, between)) return {};
    const Pose middle = workspace::pose_at(task, R, between);
    const auto here = hold.at(middle);
    if (!here) return {};
    if (here->control < kinematics::kNoHold) return middle;
    (here->determinant * sign_at_a > 0 ? a : b) = between;
  }
  const Pose end = workspace::pose_at(task, R, 0.5 * (a + b));
  const auto there = hold.at(end);
  return there && there->control < HoldAtTask::kZero ? std::optional(end) : std::nullopt;
}

}  // namespace

SingularInside singular_inside(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options) {
  SingularInside out;
  if (kinematics::is_serial(machine) || survey.inside.empty()) return out;
  // Points whose indices along the grid are multiples of `every`.
  const auto every = static_cast<int>(std::ceil(std::cbrt(double(survey.inside.size()) / double(kMostPoses))));
  const std::array<int, 3>& count = survey.grid.points;
  const auto nx = static_cast<std::size_t>(count[0]), ny = static_cast<std::size_t>(count[1]);
  const std::array<std::size_t, 3> stride{1, nx, nx * ny};
  std::vector<std::size_t> points;
  for (const std::size_t i : survey.inside) {
    const std::array<std::size_t, 3> at{i % nx, i / nx % ny, i / (nx * ny)};
    if (std::all_of(at.begin(), at.end(), [&](std::size_t n) { return n % static_cast<std::size_t>(every) == 0; }))
      points.push_back(i);
  }
  if (points.empty()) return out;
  const int side = workspace::side_of_home(machine);
  const HoldAtTask hold(machine, side);
  const std::size_t directions = std::clamp<std::size_t>(kMostPoses / points.size(), 1, survey.orientations.size());
  std::vector<double> determinant(points.size());
  std::vector<char> lost(points.size());
  for (std::size_t d = 0; d < directions; ++d) {
    const Mat3& R = survey.orientations[d];
    for_each_in_rounds(points.size(), {options.workspace.threads, {}, {}}, [&](std::size_t n) {
      const auto here = hold.at(workspace::pose_at(survey.task, R, survey.grid.at(points[n])));
      determinant[n] = here ? here->determinant : 0.0;
      lost[n] = here && here->control < kinematics::kNoHold;
    });
    for (std::size_t n = 0; n < points.size() && side != 0; ++n) {
      if (determinant[n] == 0) continue;
      ++out.beyond.points;
      if (determinant[n] * side < 0) ++out.beyond.beyond;
    }
    if (out.pose) continue;
    if (const auto at = std::find(lost.begin(), lost.end(), true); at != lost.end())
      out.pose =
          workspace::pose_at(survey.task, R, survey.grid.at(points[static_cast<std::size_t>(at - lost.begin())]));
    for (std::size_t n = 0; n < points.size() && !out.pose; ++n) {
      for (std::size_t k = 0; k < 3 && !out.pose; ++k) {
        const std::size_t along = points[n] / stride[k] % static_cast<std::size_t>(count[k]);
        if (along + static_cast<std::size_t>(every) >= static_cast<std::size_t>(count[k])) continue;
        const std::size_t next = points[n] + static_cast<std::size_t>(every) * stride[k];
        const auto at = std::lower_bound(points.begin(), points.end(), next);
        if (at == points.end() || *at != next) continue;
        if (!(determinant[n] * determinant[static_cast<std::size_t>(at - points.begin())] < 0)) continue;
        out.pose = bisected(machine, hold, options, survey.task, R, survey.grid.at(points[n]), survey.grid.at(next),
                            determinant[n]);
      }
    }
  }
  return out;
}

}  // namespace polypod::quality
