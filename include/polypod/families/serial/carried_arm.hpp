// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// An arm on an external axis: a rail, or a turntable below it.
#pragma once

#include <optional>
#include <utility>

#include "polypod/families/serial/kinematics.hpp"
#include "polypod/machine/any_machine.hpp"

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
  /// The same of any machine; other families have none.
  static std::optional<CarriedArm> on_external_axis(const AnyMachine& machine);

  /// The arm that is carried, where its base is at u = 0.
  [[nodiscard]] const SerialArm& arm() const { return inner_; }
  /// The base of that arm as its maker draws it, where u = 0: the frame behind the axis, in a modified table with the
  /// twist and the shift that stand in the row behind it, so that z is along the first joint's axis.
  [[nodiscard]] Pose root() const;
  [[nodiscard]] const DhRow& axis() const { return row_; }
  [[nodiscard]] JointRange range() const { return row_.range; }
  /// Whether the axis moves; a locked one is none of the joints.
  [[nodiscard]] bool moves() const { return !row_.locked; }
  /// Direction and a point of the screw that the axis is, in M; u counts about or along it by its sign.
  [[nodiscard]] std::pair<Vec3, Vec3> line() const { return {row_.sign * axis_, point_}; }
  /// X_k(0) X_k(u)^-1 X_MT.
  [[nodiscard]] Pose seen(const Pose& X_MT, double u) const;

  /// Solutions of the arm that is carried for seen(X_MT, u) as joints and limits of the whole arm with the axis at u;
  /// branches stay.
  [[nodiscard]] kinematics::InverseResult whole(kinematics::InverseResult found, double u) const;
  /// Joints of the whole arm without that of the axis.
  [[nodiscard]] kinematics::JointVector behind(const kinematics::JointVector& q) const;

 private:
  SerialArm inner_;
  DhRow row_;
  Vec3 axis_, point_;  ///< of the screw that the joint is, in M
};

}  // namespace polypod::machine
