// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/serial/carried_arm.hpp"

#include <algorithm>
#include <variant>

#include "polypod/families/serial/frames.hpp"
#include "polypod/families/serial/six_joint_inverse.hpp"
#include "six_joints.hpp"

namespace polypod::machine {

std::optional<CarriedArm> CarriedArm::of(const SerialArm& arm, std::size_t row) {
  if (row + 1 >= arm.dh.size()) return std::nullopt;
  const auto before = arm.dh.begin() + static_cast<std::ptrdiff_t>(row);
  if (std::any_of(arm.dh.begin(), before, [](const DhRow& r) { return !r.locked; })) return std::nullopt;
  for (auto behind = before + 1; behind != arm.dh.end(); ++behind)
    if (behind->coupled_back >= behind - before) return std::nullopt;  // it turns with what carries it
  CarriedArm out;
  out.row_ = *before;
  SerialArm at_zero = arm;
  if (out.row_.locked) at_zero.dh[row].locked = 0;
  const std::vector<Pose> frames = frames_of_table(at_zero, kinematics::JointVector::Zero(at_zero.free_joints()));
  // What the joint moves is a screw about the z axis of its frame: before the twist (standard) or behind it (modified).
  const Pose& of_joint = arm.convention == DhConvention::standard ? frames[row] : frames[row + 1];
  out.axis_ = of_joint.R.col(2);
  out.point_ = of_joint.p;
  out.inner_ = arm;
  out.inner_.X_MB = frames[row + 1];
  out.inner_.dh.assign(before + 1, arm.dh.end());
  return out;
}

std::optional<CarriedArm> CarriedArm::on_external_axis(const SerialArm& arm) {
  constexpr std::size_t kJoints = 6;
  if (arm.dh.size() <= kJoints || arm.task != Task::pose) return std::nullopt;
  std::optional<CarriedArm> out = of(arm, arm.dh.size() - kJoints - 1);
  if (!out || out->arm().free_joints() != static_cast<int>(kJoints) || !has_six_joint_branches(out->arm()))
    return std::nullopt;
  if (!out->moves() && out->axis().kind != JointKind::prismatic) return std::nullopt;  // a part of the base
  return out;
}

std::optional<CarriedArm> CarriedArm::on_external_axis(const AnyMachine& machine) {
  const auto* arm = std::get_if<SerialArm>(&machine);
  return arm != nullptr ? on_external_axis(*arm) : std::nullopt;
}

Pose CarriedArm::root() const {
  if (inner_.convention == DhConvention::standard) return inner_.X_MB;
  const DhRow& next = inner_.dh.front();
  return inner_.X_MB * Pose{rotation_x(next.alpha), Vec3(next.a, 0, 0)};
}

Pose CarriedArm::seen(const Pose& X_MT, double u) const {
  if (row_.kind == JointKind::prismatic) return {X_MT.R, X_MT.p - row_.sign * u * axis_};
  const Mat3 back = Eigen::AngleAxisd(-row_.sign * u, axis_).toRotationMatrix();
  return {back * X_MT.R, point_ + back * (X_MT.p - point_)};
}

kinematics::InverseResult CarriedArm::whole(kinematics::InverseResult found, double u) const {
  if (!moves()) return found;
  const bool low = u<row_.range.min - six::kLimitSlack, high = u> row_.range.max + six::kLimitSlack;
  for (kinematics::Solution& s : found.solutions) {
    kinematics::JointVector q(s.joints.size() + 1);
    q << u, s.joints;
    s.joints = q;
    s.violations = s.violations << 2 | kinematics::LimitBits{high} << 1 | kinematics::LimitBits{low};
  }
  return found;
}

kinematics::JointVector CarriedArm::behind(const kinematics::JointVector& q) const {
  return moves() ? kinematics::JointVector(q.tail(q.size() - 1)) : q;
}

}  // namespace polypod::machine
