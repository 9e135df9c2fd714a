// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The equations of one measured row, and their derivatives by every unknown.
#include <algorithm>
#include <cmath>
#include <limits>

#include "model.hpp"

namespace polypod::calibration {
namespace {

/// The pose of the machine near the one before, by Newton's method with F_X as it was there; as exact as
/// forward_by_closure. Nothing where that does not converge quickly. Cost: a closure a step, no derivatives.
std::optional<Pose> pose_near(const AnyMachine& machine, Numbers q, Numbers p, const Followed& before) {
  constexpr int kSteps = 10;
  const kinematics::NewtonOptions exact;
  Pose X = before.X_MT;
  double last = std::numeric_limits<double>::infinity();
  for (int k = 0; k < kSteps; ++k) {
    const kinematics::ClosureVector F = closure_of(machine, X, q, p);
    const Vec6 step = -before.by_pose->solve(F);
    const double size = std::max(step.head<3>().norm(), step.tail<3>().norm());
    if (!(size < 0.5 * last)) return {};
    X.p += step.head<3>();
    X.R = rotation_of(step.tail<3>()) * X.R;
    if (size <= exact.tolerance && F.cwiseAbs().maxCoeff() < 1e-9 * (1 + X.p.norm())) return X;
    last = size;
  }
  return {};
}

/// d exp(w) = [J_l(w) dw]x exp(w).
Mat3 left_jacobian(const Vec3& w) {
  const double angle = w.norm();
  const Mat3 W = skew(w);
  if (angle < 1e-4) return Mat3::Identity() + 0.5 * W + W * W / 6;
  return Mat3::Identity() + (1 - std::cos(angle)) / (angle * angle) * W +
         (angle - std::sin(angle)) / (angle * angle * angle) * W * W;
}

}  // namespace

Pose pose_from(const double* six) {
  return {rotation_of(Vec3(six[3], six[4], six[5])), Vec3(six[0], six[1], six[2])};
}

bool equations_of(const AnyMachine& machine, const Measurement& row, const Pose& seed_MT, const Layout& layout,
                  const Eigen::VectorXd& x, const Noise& noise, bool by_unknowns, Equations& out, Lost lost) {
  const Numbers p(x.data() + layout.parameters, static_cast<std::size_t>(x.size() - layout.parameters));
  const Numbers q(row.q.data(), static_cast<std::size_t>(row.q.size()));
  Followed* followed = out.followed;
  kinematics::NewtonResult at;
  if (followed != nullptr && followed->by_pose) {
    if (const auto near = pose_near(machine, q, p, *followed)) {
      at.X_MT = *near;
      at.converged = true;
    }
  }
  if (!at.converged) at = forward_of(machine, q, p, seed_MT);
  if (!at.converged && lost == Lost::fail) return false;
  Pose X = at.X_MT;    // where the tool is
  Pose X_A = at.X_MT;  // where the closure is differentiated
  if (!at.converged) {
    X = X_A = seed_MT;
    const Vec6 step =
        -kinematics::ClosureSolver(closure_by_pose_of(machine, X, q, p)).solve(closure_of(machine, X, q, p));
    X.p += step.head<3>();
    X.R = rotation_of(step.tail<3>()) * X.R;
  }
  const double* frame = x.data() + layout.frame;
  const double* target = x.data() + layout.target;
  const Pose X_SM = pose_from(frame), X_TR = pose_from(target);
  const Pose Y = X_SM * X * X_TR;  // the target in S
  const double k = row.kind == Kind::contact ? 1.0 : 1 + x[layout.scale];

  // Rows of dr by the twist [v; w] of the target in S, and r.
  const int n = equation_count(row.kind);
  const double s = 1 / (row.noise > 0 ? row.noise : noise.position), sa = 1 / noise.angle;
  Eigen::Matrix<double, Eigen::Dynamic, 6, 0, 6, 6> by_twist =
      Eigen::Matrix<double, Eigen::Dynamic, 6, 0, 6, 6>::Zero(n, 6);
  out.r.resize(n);
  Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 6, 1> by_scale =
      Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 6, 1>::Zero(n);
  out.sigma.setConstant(n, 1 / s);
  out.lengths = std::min(n, 3);
  const auto position = [&](const Vec3& measured) {
    out.r.head<3>() = s * (k * Y.p - measured);
    by_twist.topLeftCorner<3, 3>() = s * k * Mat3::Identity();
    if (row.kind != Kind::contact) by_scale.head<3>() = s * Y.p;
  };
  switch (row.kind) {
    case Kind::point:
      position(row.X_SR.p);
      break;
    case Kind::axis: {
      position(row.X_SR.p);
      const Vec3 along = Y.R.col(2);
      for (int i = 0; i < 2; ++i) {  // parts of the axis across the measured one
        const Vec3 across = row.X_SR.R.col(i);
        out.r[3 + i] = sa * across.dot(along);
        by_twist.block<1, 3>(3 + i, 3) = sa * along.cross(across).transpose();
      }
      break;
    }
    case Kind::pose: {
      position(row.X_SR.p);
      const Vec3 turn = rotation_vector(Y.R * row.X_SR.R.transpose());
      out.r.tail<3>() = sa * turn;
      by_twist.bottomRightCorner<3, 3>() = sa * left_jacobian(turn).inverse();
      break;
    }
    case Kind::distance: {
      const Vec3 away = Y.p - row.anchor_S;
      const double length = away.norm();
      out.r[0] = s * (k * length - row.reading);
      by_twist.block<1, 3>(0, 0) = s * k * away.transpose() / std::max(length, 1e-12);
      by_scale[0] = s * length;
      break;
    }
    case Kind::gauge:
      out.r[0] = s * (k * row.normal_S.dot(Y.p - row.anchor_S) - row.reading);
      by_twist.block<1, 3>(0, 0) = s * k * row.normal_S.transpose();
      by_scale[0] = s * row.normal_S.dot(Y.p - row.anchor_S);
      break;
    case Kind::contact:
      position(x.segment<3>(layout.contact.at(row.contact)));
      break;
  }
  for (int i = out.lengths; i < n; ++i) out.sigma[i] = noise.angle;
  if (!by_unknowns) return true;

  out.J.setZero(n, layout.count);
  if (row.kind == Kind::contact) out.J.middleCols<3>(layout.contact.at(row.contact)) = -s * Mat3::Identity();
  out.J.col(layout.scale) = by_scale;
  // By X_SM: v = dt + J_l dw x (Y.p - t).
  const Mat3 turn_frame = left_jacobian(Vec3(frame[3], frame[4], frame[5]));
  out.J.middleCols<3>(layout.frame) = by_twist.leftCols<3>();
  out.J.middleCols<3>(layout.frame + 3) =
      (by_twist.rightCols<3>() - by_twist.leftCols<3>() * skew<double>(Y.p - X_SM.p)) * turn_frame;
  // By X_TR, whose twist stands in T.
  const Mat3 R_ST = X_SM.R * X.R;
  out.J.middleCols<3>(layout.target) = by_twist.leftCols<3>() * R_ST;
  out.J.middleCols<3>(layout.target + 3) =
      by_twist.rightCols<3>() * R_ST * left_jacobian(Vec3(target[3], target[4], target[5]));
  // By p: the twist of T in M, taken to the target and into S.
  if (!out.by_parameters && (followed == nullptr || followed->by_pose)) return true;
  const kinematics::ClosureSolver A(closure_by_pose_of(machine, X_A, q, p));
  if (followed != nullptr) {
    followed->X_MT = X_A;
    followed->by_pose.reset();
    if (at.converged) followed->by_pose = A;
  }
  if (!out.by_parameters) return true;
  const Eigen::MatrixXd F_p = closure_by_parameters_of(machine, X_A, q, p, layout.slots);
  Mat6 to_target = Mat6::Zero();
  to_target.topLeftCorner<3, 3>() = X_SM.R;
  to_target.topRightCorner<3, 3>() = -X_SM.R * skew<double>(X.R * X_TR.p);
  to_target.bottomRightCorner<3, 3>() = X_SM.R;
  out.J.rightCols(F_p.cols()) = -(by_twist * to_target) * A.solve_many(F_p);
  return true;
}

}  // namespace polypod::calibration
