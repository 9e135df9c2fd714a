// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/serial/cartesian.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "six_joints.hpp"

namespace polypod::machine {
namespace {

constexpr int kLinear = 3;
constexpr double kPi = std::numbers::pi;

}  // namespace

std::optional<CartesianInverse> CartesianInverse::of(const SerialArm& arm) {
  const int joints = arm.free_joints();
  const bool serves = (arm.task == Task::axis && joints == 5) || (arm.task == Task::pose && joints == 6);
  if (!serves || arm.is_coupled()) return std::nullopt;
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

CartesianInverse::Form CartesianInverse::form() const {
  const six::Turns turns(axis_[0], axis_[1], axis_[2]);
  Form out{joints_,   range_,       axis_[0], axis_[1],  X_0_.R.transpose() * axis_[2], Vec3::Zero(), X_0_.p, point_[0],
           point_[1], turns.middle, axis_[2], to_linear_};
  if (joints_ == 6) {
    out.carried = point_[2];
    out.from_tip_T = X_0_.R.transpose() * (point_[2] - X_0_.p);
  }
  if (const auto meet = six::common_point(out.point_u, out.u, out.point_v, out.v)) out.point_u = out.point_v = *meet;
  return out;
}

kinematics::Solution CartesianInverse::with(const Pose& X_MT, std::array<double, 3> angle,
                                            const double* reference) const {
  kinematics::Solution out;
  out.joints.resize(joints_);
  Vec3 tip = X_0_.p;
  for (int i = joints_ - 1; i >= kLinear; --i) {
    const auto k = static_cast<std::size_t>(i - kLinear);
    tip = point_[k] + six::turn(axis_[k], angle[k]) * (tip - point_[k]);
    out.joints[i] = six::in_range(angle[k], range_[static_cast<std::size_t>(i)], reference, i);
  }
  out.joints.head<kLinear>() = to_linear_ * (X_MT.p - tip);
  out.violations = six::violations(range_, out.joints.data(), static_cast<std::size_t>(joints_));
  return out;
}

kinematics::InverseResult CartesianInverse::solve(const Pose& X_MT, const double* reference) const {
  kinematics::InverseResult out;
  const six::Turns turns(axis_[0], axis_[1], axis_[2]);
  const JointRange& first = range_[kLinear];
  const double free4 = reference != nullptr ? reference[kLinear] : std::clamp(0.0, first.min, first.max);
  const Mat3 R = X_MT.R * X_0_.R.transpose();
  auto found = turns.solve(R, free4);
  if (!found) {
    out.reason = "the rotary axes cannot turn the tool there";
    return out;
  }
  const bool one = std::abs(std::sin(0.5 * (found->q5[0] - found->q5[1]))) < six::kMeet;
  const bool exchanged = std::remainder(found->q5[0] - straight_, 2 * kPi) < 0;
  for (unsigned b = 0; b < 2; ++b) {
    const auto angles = [&] {
      const std::size_t f = exchanged ? 1 - b : b;
      return std::array<double, 3>{found->q4[f], found->q5[f], found->q6[f]};
    };
    // In line the other branch has q4 half a turn off; where a limit stops it, q4 turns on to where none does.
    const double start = found->in_line && b == 1 ? free4 + (free4 + kPi <= first.max ? kPi : -kPi) : free4;
    if (found->in_line && b == 1) found = turns.solve(R, start);
    kinematics::Solution solution = with(X_MT, angles(), reference);
    constexpr int kSteps = 72;
    for (int k = 1; found->in_line && k <= kSteps && solution.violations != 0; ++k) {
      const int steps = (k % 2 == 0 ? 1 : -1) * ((k + 1) / 2);  // to either side in turn
      const double turn = steps * 2 * kPi / kSteps;
      found = turns.solve(R, start + turn);
      if (kinematics::Solution other = with(X_MT, angles(), reference); other.violations == 0)
        solution = std::move(other);
    }
    solution.branch = b;
    solution.singular = one && !found->in_line;
    out.solutions.push_back(std::move(solution));
  }
  return out;
}

}  // namespace polypod::machine
