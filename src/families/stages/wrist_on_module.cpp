// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "wrist_on_module.hpp"

#include <cmath>

#include "../parallel/settle.hpp"
#include "polypod/kinematics/families.hpp"

namespace polypod::machine {
namespace {

/// A point and the direction of a line.
struct Axis {
  Vec3 point, u;
};

/// Where two lines meet; nothing where they do not, or are parallel.
std::optional<Vec3> meeting(const Axis& a, const Axis& b) {
  constexpr double kMeet = 1e-9, kAlong = 1e-6;  // m, rad
  const Vec3 n = a.u.cross(b.u);
  if (n.norm() < kAlong) return std::nullopt;
  const Vec3 between = b.point - a.point;
  if (std::abs(between.dot(n.normalized())) > kMeet) return std::nullopt;
  return a.point + between.cross(b.u).dot(n) / n.squaredNorm() * a.u;
}

bool keeps_its_orientation(const AnyMachine& module) {
  return std::holds_alternative<RotaryDelta>(module) || std::holds_alternative<LinearDelta>(module);
}

/// The angle about u that turns `from` to `to`, of equal length and of equal height along u.
double angle_about(const Vec3& u, const Vec3& from, const Vec3& to) {
  const Vec3 a = from - u.dot(from) * u, b = to - u.dot(to) * u;
  return std::atan2(u.dot(a.cross(b)), a.dot(b));
}

/// Where the turn about u2 leaves the unit vector v from which that about u1 takes it to k: two places, one where k is
/// along u1 (any turn about u1 keeps it there), or none.
std::vector<Vec3> between_turns(const Vec3& u1, const Vec3& u2, const Vec3& v, const Vec3& k) {
  constexpr double kRounding = 1e-12, kAlong = 1e-9;
  const double c = u1.dot(u2), along = u1.dot(k), radius = u1.cross(k).norm();
  const Vec3 square = (u2 - c * u1).normalized(), n = u1.cross(square);
  const double toward = (u2.dot(v) - c * along) / u2.dot(square), rest = radius * radius - toward * toward;
  if (rest < -kRounding) return {};
  const Vec3 z = along * u1 + toward * square;
  if (radius < kAlong) return {z.normalized()};
  const Vec3 aside = std::sqrt(std::max(0.0, rest)) * n;
  return {z + aside, z - aside};
}

}  // namespace

std::optional<WristOnModule> WristOnModule::of(const Stages& m) {
  if (m.machines.size() != 2 || m.closed != 0) return std::nullopt;
  const auto* wrist = std::get_if<SerialArm>(&m.machines[1]);
  if (wrist == nullptr || wrist->is_coupled()) return std::nullopt;
  const auto* legs = std::get_if<Parallel>(&m.machines[0]);
  // A module of a family of one's own may turn as it likes.
  if (legs == nullptr && !keeps_its_orientation(m.machines[0])) return std::nullopt;
  const Task module = kinematics::task(m.machines[0]);
  const int joints = m.data[1].joints;
  const bool axis = m.task.places() && m.task.names_axis() && m.task.size() == 5;
  if (!module.places() || module.size() != 3 || joints != (axis ? 2 : 3) || joints + 3 != m.task.size())
    return std::nullopt;
  const JointVector zero = JointVector::Zero(joints);
  const Pose X_0 = forward(*wrist, zero);
  const JacobianMatrix J = jacobian(*wrist, X_0, zero);
  std::vector<Axis> axes;
  WristOnModule out;
  for (int i = 0; i < joints; ++i) {
    if (joint_kind(*wrist, i) != JointKind::revolute) return std::nullopt;
    const Vec3 way = J.col(i).head<3>(), u = J.col(i).tail<3>();
    axes.push_back({X_0.p - way.cross(u), u});
    out.u_.push_back(u);
  }
  if (axis) axes.push_back({X_0.p, X_0.R.col(2)});
  const std::optional<Vec3> W = meeting(axes[0], axes[1]);
  constexpr double kMeet = 1e-9;  // m
  if (!W || (*W - axes[2].point).cross(axes[2].u).norm() > kMeet) return std::nullopt;
  // Where the last axis lies along the one before, nothing turns it.
  constexpr double kAlong = 1e-6;
  if (axes[1].u.cross(axes[2].u).norm() < kAlong) return std::nullopt;
  out.W_ = *W;
  out.v_ = m.data[1].mount * *W;
  if (legs != nullptr) out.placing_ = with_tip_at(*legs, out.v_);
  out.W_T_ = X_0.inverse() * *W;
  out.R_0_ = X_0.R;
  return out;
}

std::optional<Pose> WristOnModule::module_at(const Stages& m, const Vec3& c) const {
  Mat3 R = kinematics::home_pose(m.machines[0]).value_or(Pose{}).R;
  if (placing_) {
    const std::optional<Pose> X = settled(*placing_, Pose{R, c});
    if (!X) return std::nullopt;
    R = X->R;
  }
  return Pose{R, c - R * v_};
}

WristOnModule::Found WristOnModule::solve(const Stages& m, const Pose& X_MT, double first) const {
  Found out;
  const Pose& mount = m.data[0].mount;
  const std::optional<Pose> X = module_at(m, mount.inverse() * (X_MT * W_T_));
  if (!X) {
    out.reason = "the module that carries the wrist was not found to bring the wrist's centre there";
    return out;
  }
  // What the wrist must turn: R = E_1 E_2 (E_3) R_0, in its own {M}.
  const Mat3 R = (mount.R * X->R * m.data[1].mount.R).transpose() * X_MT.R;
  const bool three = u_.size() == 3;
  const Vec3 v = three ? u_[2] : Vec3(R_0_.col(2));
  const Vec3 k = three ? Vec3(R * R_0_.transpose() * u_[2]) : Vec3(R.col(2));
  const std::vector<Vec3> places = between_turns(u_[0], u_[1], v, k);
  for (const Vec3& z : places) {
    Posture posture;
    posture.singular = places.size() == 1;
    JointVector q(static_cast<Eigen::Index>(u_.size()));
    q[1] = angle_about(u_[1], v, z);
    q[0] = posture.singular ? first : angle_about(u_[0], z, k);
    if (three) {
      const Mat3 E_3 = (rotation_of(q[0] * u_[0]) * rotation_of(q[1] * u_[1])).transpose() * R * R_0_.transpose();
      const Vec3 aside = u_[2].unitOrthogonal();
      q[2] = angle_about(u_[2], aside, E_3 * aside);
    }
    posture.stages.resize(2);
    posture.stages[0] = {mount, *X, {}};
    posture.stages[1] = {mount * *X * m.data[1].mount, forward(std::get<SerialArm>(m.machines[1]), q), q};
    out.postures.push_back(std::move(posture));
  }
  if (out.postures.empty()) out.reason = "the wrist cannot turn the tool there";
  return out;
}

}  // namespace polypod::machine
