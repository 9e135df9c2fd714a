// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "scara.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "six_joints.hpp"

namespace polypod::machine {
namespace {

double direction_of(const Vec3& v) {
  return std::atan2(v.y(), v.x());
}
double length_of(const Vec3& v) {
  return std::hypot(v.x(), v.y());
}

}  // namespace

std::optional<ScaraInverse> ScaraInverse::of(const SerialArm& arm) {
  const Task& t = arm.task;
  const bool task = t.size() == 4 && t.places() && t.holds(Coordinate::c);
  if (!task || arm.free_joints() != kJoints || arm.is_coupled()) return std::nullopt;
  ScaraInverse out;
  const ForwardJacobian at_zero = forward_jacobian(arm, JointVector::Zero(kJoints));
  out.X_0_ = at_zero.X_MT;
  out.c_0_ = angles_abc(out.X_0_.R).z();
  int joint = 0;
  std::size_t turning = 0;
  for (const DhRow& row : arm.dh) {
    if (row.locked) continue;
    const bool turns = row.kind == JointKind::revolute;
    const Vec3 linear = at_zero.J.col(joint).head<3>(), angular = at_zero.J.col(joint).tail<3>();
    const Vec3 axis = turns ? angular : linear;
    if (std::hypot(axis.x(), axis.y()) > six::kSame) return std::nullopt;
    out.range_[static_cast<std::size_t>(joint)] = row.range;
    const double sense = axis.z() > 0 ? 1 : -1;
    if (turns) {
      if (turning == out.turning_.size()) return std::nullopt;
      out.turning_[turning] = joint;
      out.sense_[turning] = sense;
      out.point_[turning++] = out.X_0_.p + angular.cross(linear);
    } else {
      out.slide_ = joint;
      out.slide_sense_ = sense;
    }
    ++joint;
  }
  if (turning != out.turning_.size()) return std::nullopt;
  const bool links =
      length_of(out.point_[1] - out.point_[0]) > six::kSame && length_of(out.point_[2] - out.point_[1]) > six::kSame;
  // At B = +-90 deg there is no C.
  const bool has_c = std::hypot(out.X_0_.R(0, 0), out.X_0_.R(1, 0)) > six::kSame;
  return links && has_c ? std::optional(out) : std::nullopt;
}

ScaraInverse::Form ScaraInverse::form() const {
  const Vec3 first = point_[1] - point_[0], second = point_[2] - point_[1];
  return {range_,
          turning_,
          sense_,
          slide_,
          slide_sense_,
          X_0_.p.z(),
          c_0_,
          point_[0],
          X_0_.p - point_[2],
          length_of(first),
          length_of(second),
          direction_of(first),
          direction_of(second) - direction_of(first)};
}

kinematics::InverseResult ScaraInverse::solve(const Pose& X_MT, const double* reference) const {
  kinematics::InverseResult out;
  const double phi = angles_abc(X_MT.R).z() - c_0_;
  const Vec3 first = point_[1] - point_[0], second = point_[2] - point_[1];
  const Vec3 r = X_MT.p - rotation_z(phi) * (X_0_.p - point_[2]) - point_[0];
  const double l_1 = length_of(first), l_2 = length_of(second), reach = length_of(r);
  const double cosine = (reach * reach - l_1 * l_1 - l_2 * l_2) / (2 * l_1 * l_2);
  if (std::abs(cosine) > 1 + six::kStretched) {
    out.reason = "the third turning axis is out of reach of the two links";
    return out;
  }
  const double bend = std::acos(std::clamp(cosine, -1.0, 1.0));
  const bool over_first = reach < six::kFree;
  for (unsigned b = 0; b < 2; ++b) {
    const double beta = b == 0 ? bend : -bend;
    std::array<double, 3> theta{};
    const double to_wrist = std::atan2(l_2 * std::sin(beta), l_1 + l_2 * std::cos(beta));
    theta[0] = over_first && reference != nullptr ? sense_[0] * reference[turning_[0]]
                                                  : (over_first ? 0 : direction_of(r)) - to_wrist - direction_of(first);
    theta[1] = beta - (direction_of(second) - direction_of(first));
    theta[2] = phi - theta[0] - theta[1];
    kinematics::Solution s;
    s.joints.resize(kJoints);
    for (std::size_t i = 0; i < theta.size(); ++i) {
      const int joint = turning_[i];
      s.joints[joint] = six::in_range(std::remainder(sense_[i] * theta[i], 2 * std::numbers::pi),
                                      range_[static_cast<std::size_t>(joint)], reference, joint);
    }
    s.joints[slide_] = slide_sense_ * (X_MT.p.z() - X_0_.p.z());
    s.branch = b;
    s.violations = six::violations(range_, s.joints.data(), kJoints);
    s.singular = over_first || std::abs(std::sin(bend)) < six::kMeet;
    out.solutions.push_back(std::move(s));
  }
  return out;
}

}  // namespace polypod::machine
