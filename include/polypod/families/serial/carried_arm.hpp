// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// An arm on an external axis: a rail, or a turntable below it.
#pragma once

#include <optional>

#include "polypod/families/serial/kinematics.hpp"

namespace polypod::machine {

/// An arm as the joint sees it that carries it. With X_k(u) the frame behind that joint, the arm behind it has its base
/// at X_k(0), and of a pose X_MT it sees X_k(0) X_k(u)^-1 X_MT.
class CarriedArm {
 public:
  /// What row `row` of the table (from 0) carries; the rows before it are the base. Nothing where a row before it
  /// moves, none is behind it, or one behind it is coupled to it.
  static std::optional<CarriedArm> of(const SerialArm& arm, std::size_t row = 0);
  /// The external axis of a robot (E1, eax_a): the row before the last six, if these are six joints with a closed
  /// inverse and the rows before it are locked. It moves, or is a rail that is locked.
  static std::optional<CarriedArm> on_external_axis(const SerialArm& arm);

  /// The arm that is carried, where its base is at u = 0.
  [[nodiscard]] const SerialArm& arm() const { return inner_; }
  [[nodiscard]] const DhRow& axis() const { return row_; }
  [[nodiscard]] JointRange range() const { return row_.range; }
  /// Whether the axis moves; a locked one is none of the joints.
  [[nodiscard]] bool moves() const { return !row_.locked; }
  /// X_k(0) X_k(u)^-1 X_MT.
  [[nodiscard]] Pose seen(const Pose& X_MT, double u) const;

  /// The solutions with the axis at u (rad or m), as joints and limits of the whole arm: inverse, and inverse_near the
  /// joints `last` of the whole arm. Branches are those of the arm that is carried. Cost: that of its inverse.
  [[nodiscard]] kinematics::InverseResult inverse(const Pose& X_MT, double u) const;
  [[nodiscard]] kinematics::InverseResult inverse_near(const Pose& X_MT, double u,
                                                       const kinematics::JointVector& last) const;

 private:
  [[nodiscard]] kinematics::InverseResult whole(kinematics::InverseResult found, double u) const;

  SerialArm inner_;
  DhRow row_;
  Vec3 axis_, point_;  ///< of the screw that the joint is, in M
};

}  // namespace polypod::machine
