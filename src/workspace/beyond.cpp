// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/workspace/beyond.hpp"

#include "polypod/core/random.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/hold.hpp"
#include "polypod/workspace/task_directions.hpp"

namespace polypod::workspace {

int side_of_home(const AnyMachine& machine) {
  if (kinematics::takes_any_posture(machine)) return 0;
  const auto home = kinematics::home_pose(machine);
  if (!home) return 0;
  const kinematics::InverseResult there = kinematics::inverse(machine, *home);
  if (there.solutions.empty()) return 0;
  const machine::JointVector& q = there.solutions.front().joints;
  const kinematics::Hold hold = kinematics::hold(machine, kinematics::settled(machine, *home, q), q);
  if (hold.determinant == 0 || hold.control < kinematics::kNoHold) return 0;
  return hold.determinant > 0 ? 1 : -1;
}

BeyondSingular beyond_singular(const AnyMachine& machine, const Options& options, const Volume& volume) {
  constexpr std::size_t kPoints = 400, kDraws = 20'000;
  BeyondSingular out;
  const int side = side_of_home(machine);
  const machine::Task task = kinematics::task(machine);
  const bool places = task.places();
  if (side == 0 || volume.empty || (!places && task.size() != 3)) return out;
  const std::vector<Mat3> orientations = sampled_orientations(options.directions);
  const kinematics::HoldAnywhere hold(machine);
  Random random(1);
  for (std::size_t draw = 0; draw < kDraws && out.points < kPoints; ++draw) {
    Vec3 p;
    for (int k = 0; k < 3; ++k) p[k] = random.uniform(volume.min[k], volume.max[k]);
    if (places && !reaches_samples(machine, options, orientations, p)) continue;
    const Pose target = pose_at(task, orientations.front(), p);
    const kinematics::InverseResult found = kinematics::inverse(machine, target);
    const kinematics::Solution* reached = places ? &found.solutions.front() : found.reachable();
    if (reached == nullptr) continue;
    const machine::JointVector& q = reached->joints;
    ++out.points;
    if (hold.at(kinematics::settled(machine, target, q), q).determinant * side < 0) ++out.beyond;
  }
  return out;
}

}  // namespace polypod::workspace
