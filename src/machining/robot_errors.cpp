// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "robot_errors.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <variant>

#include "../families/all_masses.hpp"
#include "polypod/core/text.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/forward_near.hpp"
#include "polypod/machining/tilted.hpp"

namespace polypod::machining {
namespace {

/// The compliance of what each joint's drive moves, rad/Nm or m/N; 0 where none is known.
std::vector<double> drive_compliances(const machine::AnyMachine& machine) {
  const auto joints = static_cast<std::size_t>(kinematics::joint_count(machine));
  const std::vector<machine::Element> elements = kinematics::elements(machine);
  std::vector<double> out(joints, 0);
  for (std::size_t e = 0; e < elements.size(); ++e) {
    const int element = static_cast<int>(e);
    int joint = std::visit([element](const auto& m) { return motion::joint_moved_by(m, element); }, machine);
    if (joint == machine::kNoJoint && elements.size() == joints) joint = element;  // legs, one a drive
    if (joint >= 0) out[static_cast<std::size_t>(joint)] += elements[e].compliance;
  }
  return out;
}

}  // namespace

RobotErrorsOnWay::RobotErrorsOnWay(const Job& job, Play play) : job_(job), play_(play) {
  const auto joints = static_cast<std::size_t>(kinematics::joint_count(job.machine));
  half_.assign(joints, 0);
  sense_.assign(joints, 0);
  const RobotErrors& errors = job.robot_errors;
  const std::vector<double> compliance = drive_compliances(job.machine);
  for (std::size_t i = 0; i < joints; ++i) {
    if (!errors.backlash.empty()) half_[i] += 0.5 * errors.backlash[i];
    if (!errors.friction.empty()) half_[i] += compliance[i] * errors.friction[i];
  }
}

Vec3 RobotErrorsOnWay::at(const Sample& sample) {
  const Pose X_MT{cutting_orientation(job_, sample.axes), job_.X_MW * sample.command};
  const std::optional<machine::JointVector> q = joints_at(job_, X_MT, sample);
  if (!q) {
    all_known_ = false;
    return Vec3::Zero();
  }
  constexpr double kStill = 1e-12;  // rad or m: rounding of the inverse
  if (!joints_) joints_ = q;        // in the middle of its play
  machine::JointVector dq(q->size());
  for (Eigen::Index i = 0; i < q->size(); ++i) {
    const auto at = static_cast<std::size_t>(i);
    const double drive = (*q)[i], moved = drives_ ? drive - (*drives_)[i] : 0;
    if (std::abs(moved) > kStill) sense_[at] = moved > 0 ? 1 : -1;
    double& joint = (*joints_)[i];
    joint = std::clamp(joint, drive - half_[at], drive + half_[at]);
    dq[i] = play_ == Play::taken_up ? -sense_[at] * half_[at] : joint - drive;
  }
  drives_ = q;
  const Pose X = kinematics::settled(job_.machine, X_MT, *q);
  Vec3 off = kinematics::jacobian(job_.machine, X, *q).topRows<3>() * dq;
  if (job_.robot_errors.signature) {
    const auto real = kinematics::forward_near(*job_.robot_errors.signature, *q, X);
    all_known_ = all_known_ && !real.poses.empty();
    if (!real.poses.empty()) off += real.poses.front().p - X.p;
  }
  return job_.X_MW.R.transpose() * off;
}

std::string friction_without_effect(const Job& job) {
  const std::vector<double>& friction = job.robot_errors.friction;
  const std::vector<double> compliance = drive_compliances(job.machine);
  std::vector<std::string> joints;
  for (std::size_t i = 0; i < friction.size(); ++i)
    if (friction[i] > 0 && !(compliance[i] > 0)) joints.push_back(fmt::format("{}", i + 1));
  if (joints.empty()) return {};
  return fmt::format("the friction of joint{} {} is not counted: the machine file gives no compliance there",
                     joints.size() == 1 ? "" : "s", listed(joints));
}

}  // namespace polypod::machining
