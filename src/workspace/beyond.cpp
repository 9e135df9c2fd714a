// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/workspace/beyond.hpp"

#include <algorithm>
#include <vector>

#include "polypod/core/random.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/hold.hpp"
#include "polypod/workspace/task_directions.hpp"

namespace polypod::workspace {

int side_of_home(const AnyMachine& machine) {
  if (kinematics::is_serial(machine)) return 0;
  const auto home = kinematics::home_pose(machine);
  if (!home) return 0;
  const kinematics::InverseResult there = kinematics::inverse(machine, *home);
  if (there.solutions.empty()) return 0;
  const machine::JointVector& q = there.solutions.front().joints;
  const kinematics::Hold hold = kinematics::hold(machine, kinematics::settled(machine, *home, q), q);
  if (hold.determinant == 0 || hold.control < kinematics::kNoHold) return 0;
  return hold.determinant > 0 ? 1 : -1;
}

std::optional<kinematics::Hold> reached_on_side(const AnyMachine& machine, const kinematics::HoldAnywhere& hold,
                                                const Pose& target, int side, kinematics::LimitBits heeded,
                                                double enough) {
  const bool any_posture = kinematics::takes_any_posture(machine);
  std::optional<kinematics::Hold> out;
  for (const kinematics::Solution& s : kinematics::inverse(machine, target).solutions) {
    if ((s.violations & heeded) != 0) continue;
    const kinematics::Hold here = hold.at(kinematics::settled(machine, target, s.joints), s.joints, enough);
    if (!out) out = here;
    if (here.determinant * side > 0) return here;
    if (!any_posture) break;
  }
  return out;
}

namespace {

/// Counts points of a workspace by the side of singular poses on which they lie.
class Sides {
 public:
  Sides(const AnyMachine& machine, const Options& options)
      : machine_(machine),
        options_(options),
        side_(side_of_home(machine)),
        task_(kinematics::task(machine)),
        orientations_(sampled_orientations(options.directions)),
        hold_(machine) {}

  [[nodiscard]] bool have_meaning() const { return side_ != 0 && (task_.places() || task_.size() <= 3); }
  void add(const Vec3& p) {
    if (task_.places() && !reaches_samples(machine_, options_, orientations_, p)) return;
    const Pose target = pose_at(task_, orientations_.front(), p);
    const auto reached = reached_on_side(machine_, hold_, target, side_, checked_limits(machine_, options_));
    if (!reached) return;
    ++out_.points;
    if (reached->determinant * side_ < 0) ++out_.beyond;
  }
  [[nodiscard]] const BeyondSingular& found() const { return out_; }

 private:
  const AnyMachine& machine_;
  const Options& options_;
  int side_;
  machine::Task task_;
  std::vector<Mat3> orientations_;
  kinematics::HoldAnywhere hold_;
  BeyondSingular out_;
};

constexpr std::size_t kPoints = 400;

}  // namespace

BeyondSingular beyond_singular(const AnyMachine& machine, const Options& options, const Volume& volume) {
  constexpr std::size_t kDraws = 20'000;
  Sides sides(machine, options);
  if (volume.empty || !sides.have_meaning()) return {};
  Random random(1);
  for (std::size_t draw = 0; draw < kDraws && sides.found().points < kPoints; ++draw) {
    Vec3 p;
    for (int k = 0; k < 3; ++k) p[k] = random.uniform(volume.min[k], volume.max[k]);
    sides.add(p);
  }
  return sides.found();
}

BeyondSingular beyond_singular(const AnyMachine& machine, const Options& options, const Field& field) {
  Sides sides(machine, options);
  if (!sides.have_meaning()) return {};
  std::vector<std::size_t> inside;
  for (std::size_t i = 0; i < field.grid.size(); ++i)
    if (field.margin[i] >= 0) inside.push_back(i);
  const std::size_t drawn = std::min(kPoints, inside.size());
  for (std::size_t n = 0; n < drawn; ++n) sides.add(field.grid.at(inside[n * inside.size() / drawn]));
  return sides.found();
}

}  // namespace polypod::workspace
