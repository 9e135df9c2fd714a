// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/workspace/beyond.hpp"

#include <Eigen/LU>
#include <cmath>

#include "polypod/core/random.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/closure.hpp"
#include "polypod/kinematics/families.hpp"

namespace polypod::workspace {
namespace {

/// det F_X with angles on the length L, over the product of the rows' norms; 0 where F has not six equations.
double handedness(const AnyMachine& machine, const Pose& X, const machine::JointVector& q, double L) {
  return std::visit(
      [&](const auto& m) {
        const std::vector<double> p = kinematics::nominal_parameters(m);
        const std::span<const double> joints(q.data(), static_cast<std::size_t>(q.size()));
        Eigen::MatrixXd A = kinematics::closure_by_pose(m, X, joints, p);
        if (A.rows() != 6) return 0.0;
        A.rightCols(3) /= L;
        for (int i = 0; i < 6; ++i) A.row(i) /= std::max(A.row(i).norm(), 1e-300);
        return A.determinant();
      },
      machine);
}

}  // namespace

BeyondSingular beyond_singular(const AnyMachine& machine, const Options& options, const Volume& volume) {
  constexpr std::size_t kPoints = 400, kDraws = 20'000;
  constexpr double kSingular = 1e-9;
  BeyondSingular out;
  const auto home = kinematics::home_pose(machine);
  if (kinematics::takes_any_posture(machine) || !home || volume.empty) return out;
  const machine::Task task = kinematics::task(machine);
  const bool places = task.places();
  if (!places && task.size() != 3) return out;
  const kinematics::InverseResult at_home = kinematics::inverse(machine, *home);
  if (at_home.solutions.empty()) return out;
  const machine::JointVector& q_home = at_home.solutions.front().joints;
  const Pose X_home = kinematics::settled(machine, *home, q_home);
  const double L = kinematics::dexterity(machine, X_home, q_home).characteristic_length;
  const double sign = handedness(machine, X_home, q_home, L);
  if (!(std::abs(sign) > kSingular)) return out;
  const std::vector<Mat3> orientations = sampled_orientations(options.directions);
  Random random(1);
  for (std::size_t draw = 0; draw < kDraws && out.points < kPoints; ++draw) {
    Vec3 p;  // or the three coordinates of the task
    for (int k = 0; k < 3; ++k) p[k] = random.uniform(volume.min[k], volume.max[k]);
    if (places && !reaches_samples(machine, options, orientations, p)) continue;
    const Pose target = places ? Pose{orientations.front(), p} : kinematics::pose_of(task, {p.x(), p.y(), p.z()});
    const kinematics::InverseResult found = kinematics::inverse(machine, target);
    const kinematics::Solution* reached = places ? &found.solutions.front() : found.reachable();
    if (reached == nullptr) continue;
    const machine::JointVector& q = reached->joints;
    const double here = handedness(machine, kinematics::settled(machine, target, q), q, L);
    ++out.points;
    if (here * sign < 0) ++out.beyond;
  }
  return out;
}

}  // namespace polypod::workspace
