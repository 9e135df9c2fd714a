// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/serial/cartesian.hpp"

#include <Eigen/LU>
#include <cmath>
#include <numbers>

#include "six_joints.hpp"

namespace polypod::machine {
namespace {

constexpr int kLinear = 3;
constexpr double kPi = std::numbers::pi;

}  // namespace

std::optional<CartesianInverse> CartesianInverse::of(const SerialArm& arm) {
  const int joints = arm.free_joints();
  const bool serves = (arm.task == Task::axis && joints == 5) || (arm.task == Task::pose && joints == 6);
  if (!serves) return std::nullopt;
  CartesianInverse out;
  out.joints_ = joints;
  int next = 0;
  for (const DhRow& row : arm.dh) {
    if (row.locked) continue;
    if ((row.kind == JointKind::prismatic) != (next < kLinear)) return std::nullopt;
    out.range_[static_cast<std::size_t>(next++)] = row.range;
  }
  const ForwardJacobian at_zero = forward_jacobian(arm, JointVector::Zero(joints));
  out.X_0_ = at_zero.X_MT;
  const Mat3 D = at_zero.J.topLeftCorner<3, kLinear>();
  if (std::abs(D.determinant()) < six::kSame) return std::nullopt;
  out.to_linear_ = D.inverse();
  for (int i = kLinear; i < joints; ++i) {
    const auto k = static_cast<std::size_t>(i - kLinear);
    const Vec3 v = at_zero.J.col(i).head<3>(), w = at_zero.J.col(i).tail<3>();
    out.axis_[k] = w;
    out.point_[k] = out.X_0_.p + w.cross(v);
  }
  if (joints == 5) out.axis_[2] = out.X_0_.R.col(2);
  // The sides of the spherical triangle.
  if (out.axis_[0].cross(out.axis_[1]).norm() < six::kSame || out.axis_[1].cross(out.axis_[2]).norm() < six::kSame)
    return std::nullopt;
  const six::Turns turns(out.axis_[0], out.axis_[1], out.axis_[2]);
  const double opposite = std::remainder(turns.middle + kPi, 2 * kPi);
  const double apart = std::abs(std::sin(turns.a - turns.b)) - std::abs(std::sin(turns.a + turns.b));
  const bool both = std::abs(apart) < six::kSame;
  out.straight_ =
      (both ? std::abs(opposite) < std::abs(turns.middle) - six::kSame : apart > 0) ? opposite : turns.middle;
  return out;
}

kinematics::InverseResult CartesianInverse::solve(const Pose& X_MT, const double* reference) const {
  kinematics::InverseResult out;
  const six::Turns turns(axis_[0], axis_[1], axis_[2]);
  const double free4 = reference == nullptr ? 0 : reference[kLinear];
  const auto found = turns.solve(X_MT.R * X_0_.R.transpose(), free4);
  if (!found) {
    out.reason = "the rotary axes cannot turn the tool there";
    return out;
  }
  const bool one = std::abs(std::sin(0.5 * (found->q5[0] - found->q5[1]))) < six::kMeet;
  const bool exchanged = std::remainder(found->q5[0] - straight_, 2 * kPi) < 0;
  for (int b = 0; b < 2; ++b) {
    const int f = exchanged ? 1 - b : b;
    const double angle[3] = {found->q4[f], found->q5[f], found->q6[f]};
    kinematics::Solution solution;
    solution.joints.resize(joints_);
    Vec3 tip = X_0_.p;
    for (int i = joints_ - 1; i >= kLinear; --i) {
      const auto k = static_cast<std::size_t>(i - kLinear);
      tip = point_[k] + six::turn(axis_[k], angle[k]) * (tip - point_[k]);
      solution.joints[i] = six::in_range(angle[k], range_[static_cast<std::size_t>(i)], reference, i);
    }
    solution.joints.head<kLinear>() = to_linear_ * (X_MT.p - tip);
    for (int i = 0; i < joints_; ++i) {
      const JointRange& range = range_[static_cast<std::size_t>(i)];
      solution.violations |= LimitBits{solution.joints[i] < range.min - six::kLimitSlack} << (2 * i);
      solution.violations |= LimitBits{solution.joints[i] > range.max + six::kLimitSlack} << (2 * i + 1);
    }
    solution.branch = static_cast<unsigned>(b);
    solution.singular = one && !found->in_line;
    out.solutions.push_back(std::move(solution));
  }
  return out;
}

}  // namespace polypod::machine
