// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A machine at many poses, for scenes that turn.
#pragma once

#include <string>
#include <vector>

#include "polypod/machine/any_machine.hpp"
#include "polypod/pages/machine.hpp"
#include "polypod/report/scene.hpp"

namespace polypod::pages {

/// The lines of a machine at one pose, and rows of pictures of it at others.
class MovingMachine {
 public:
  /// At the pose X with the joints q (rad or m) that belong to it.
  MovingMachine(const machine::AnyMachine& machine, const Pose& X, const machine::JointVector& q);

  /// Base, legs or links, platform, joints and tool in M, mm; what does not stand still moves with the frames.
  [[nodiscard]] const std::vector<report::Line3>& lines() const { return lines_; }

  /// Adds a picture at `at` (in the frames' unit). What is broken at the pose stands in `notes`, with `note` before it.
  /// False, and nothing is added, where the outline has not the parts that it has at the first pose.
  bool add(report::Frames& frames, double at, const Pose& X, const machine::JointVector& q,
           const std::string& note = {}) const;

  /// A row a coordinate of the task through the first pose (from `low` to `high`, mm, for lengths and +-`tilt`, rad,
  /// for angles) and one a joint within its range, `count` pictures each; the other coordinates or joints stay as
  /// they are. Each picture shows the solution within the limits next to the picture before it, or the next solution
  /// where none keeps them. Poses that nothing reaches are left out, and rows of less than three pictures.
  [[nodiscard]] std::vector<report::Frames> sweeps(const report::Point3& low, const report::Point3& high, double tilt,
                                                   int count) const;

 private:
  const machine::AnyMachine& machine_;
  Pose X_;
  machine::JointVector q_;
  std::vector<report::Line3> lines_;
};

/// Gives a scene sliders for pose and joints: its first `lines` lines are the machine at `start`; lengths go as far as
/// the meshes, angles to +-`tilt`, rad. Nothing changes where the machine takes no such pose.
void add_poses(report::Scene& scene, std::size_t lines, const machine::AnyMachine& machine, const MachineAt& start,
               double tilt);

}  // namespace polypod::pages
