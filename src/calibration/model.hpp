// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a machine with certain parameters lets an instrument see, and how that changes with each unknown. Shared by
// calibration and the choice of poses.
#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <limits>
#include <map>
#include <optional>

#include "polypod/calibration/calibrate.hpp"
#include "polypod/kinematics/by_parameters.hpp"
#include "polypod/kinematics/closure_slots.hpp"
#include "polypod/kinematics/families.hpp"

namespace polypod::calibration {

/// The unknowns beside the machine's parameters, in one vector with them:
///   [ places of contacts, 3 each | X_SM: translation, rotation vector | X_TR: the same | k | parameters p ],
/// the instrument showing 1 + k times the true lengths, about the origin of its frame S.
struct Layout {
  std::map<std::string, int> contact;  ///< text of the column -> index of its first unknown
  int frame = 0, target = 0, scale = 0, parameters = 0, count = 0;
  /// Which parameters can share a derivative; without it each has one of its own.
  std::optional<kinematics::ParameterSlots> slots{};
};
Layout layout_of(const std::vector<Measurement>& rows, std::size_t parameter_count);

/// Which parameters the options ask for. Errors: CA114.
Result<std::vector<bool>> chosen_parameters(const std::vector<machine::Parameter>& all,
                                            const CalibrationOptions& options);
/// The columns of the unknowns that the options ask for, in the order in which they are told; `turns`: angles were
/// measured, so that the target's own orientation shows.
std::vector<int> wanted_unknowns(const Layout& layout, const std::vector<bool>& chosen,
                                 const CalibrationOptions& options, bool turns);
/// The name and unit of one column.
machine::Parameter unknown_of(const AnyMachine& machine, const Layout& layout, int column);

/// How exactly the instrument measures.
struct Noise {
  double position = 0;  ///< m, of each coordinate, distance or reading
  double angle = 0;     ///< rad, of each angle
};

inline int equation_count(Kind kind) {
  switch (kind) {
    case Kind::axis:
      return 5;
    case Kind::pose:
      return 6;
    case Kind::point:
    case Kind::contact:
      return 3;
    case Kind::distance:
    case Kind::gauge:
      break;
  }
  return 1;
}

/// What a search knows of one row from the place where it looked before: it comes back with parameters that hardly
/// changed.
struct Followed {
  Pose X_MT;
  std::optional<Eigen::CompleteOrthogonalDecomposition<kinematics::ClosureMatrix>> by_pose;  ///< F_X there, or near
};

/// Equations of one row, divided by their noise: (computed - measured) / sigma, and their derivatives by all unknowns.
struct Equations {
  Eigen::VectorXd r;
  Eigen::MatrixXd J;             ///< equations x unknowns
  Eigen::VectorXd sigma;         ///< m or rad
  int lengths = 0;               ///< the first equations are lengths, the rest angles
  bool by_parameters = true;     ///< else their columns of J stay 0
  Followed* followed = nullptr;  ///< of this row, if a search follows it
};

/// The pose of the machine near the one before, by Newton's method with F_X as it was there; as exact as
/// forward_by_closure. Nothing where that does not converge quickly. Cost: a closure a step, no derivatives.
template <kinematics::Machine M>
std::optional<Pose> pose_near(const M& m, std::span<const double> q, std::span<const double> p,
                              const Followed& before) {
  constexpr int kSteps = 10;
  const kinematics::NewtonOptions exact;
  Pose X = before.X_MT;
  double last = std::numeric_limits<double>::infinity();
  for (int k = 0; k < kSteps; ++k) {
    const kinematics::ClosureVector F = closure(m, X, q, p);
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

inline Pose pose_from(const double* six) {
  return {rotation_of(Vec3(six[3], six[4], six[5])), Vec3(six[0], six[1], six[2])};
}

/// d exp(w) = [J_l(w) dw]x exp(w).
inline Mat3 left_jacobian(const Vec3& w) {
  const double angle = w.norm();
  const Mat3 W = skew(w);
  if (angle < 1e-4) return Mat3::Identity() + 0.5 * W + W * W / 6;
  return Mat3::Identity() + (1 - std::cos(angle)) / (angle * angle) * W +
         (angle - std::sin(angle)) / (angle * angle * angle) * W * W;
}

/// What to do where the machine does not assemble with the parameters of a trial step.
enum class Lost {
  fail,        ///< say so
  first_order  ///< one step of Newton from the seed: finite and smooth, so that a search can go on and come back
};

/// The equations of a row at the unknowns x, with the pose of the machine found by Newton from `seed_MT` (the nominal
/// one). With `by_unknowns` also J, from dX = -A^-1 F_p dp. False where the machine does not assemble and that counts.
template <kinematics::Machine M>
bool equations_of(const M& m, const Measurement& row, const Pose& seed_MT, const Layout& layout,
                  const Eigen::VectorXd& x, const Noise& noise, bool by_unknowns, Equations& out,
                  Lost lost = Lost::fail) {
  const std::span<const double> p(x.data() + layout.parameters, static_cast<std::size_t>(x.size() - layout.parameters));
  const std::span<const double> q(row.q.data(), static_cast<std::size_t>(row.q.size()));
  Followed* followed = out.followed;
  kinematics::NewtonResult at;
  if (followed != nullptr && followed->by_pose) {
    if (const auto near = pose_near(m, q, p, *followed)) {
      at.X_MT = *near;
      at.converged = true;
    }
  }
  if (!at.converged) at = kinematics::forward_by_closure(m, q, p, seed_MT);
  if (!at.converged && lost == Lost::fail) return false;
  Pose X = at.X_MT;    // where the tool is
  Pose X_A = at.X_MT;  // where the closure is differentiated
  if (!at.converged) {
    X = X_A = seed_MT;
    const Vec6 step =
        -kinematics::closure_by_pose(m, X, q, p).completeOrthogonalDecomposition().solve(closure(m, X, q, p));
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
    by_twist.template topLeftCorner<3, 3>() = s * k * Mat3::Identity();
    if (row.kind != Kind::contact) by_scale.template head<3>() = s * Y.p;
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
        by_twist.template block<1, 3>(3 + i, 3) = sa * along.cross(across).transpose();
      }
      break;
    }
    case Kind::pose: {
      position(row.X_SR.p);
      const Vec3 turn = rotation_vector(Y.R * row.X_SR.R.transpose());
      out.r.tail<3>() = sa * turn;
      by_twist.template bottomRightCorner<3, 3>() = sa * left_jacobian(turn).inverse();
      break;
    }
    case Kind::distance: {
      const Vec3 away = Y.p - row.anchor_S;
      const double length = away.norm();
      out.r[0] = s * (k * length - row.reading);
      by_twist.template block<1, 3>(0, 0) = s * k * away.transpose() / std::max(length, 1e-12);
      by_scale[0] = s * length;
      break;
    }
    case Kind::gauge:
      out.r[0] = s * (k * row.normal_S.dot(Y.p - row.anchor_S) - row.reading);
      by_twist.template block<1, 3>(0, 0) = s * k * row.normal_S.transpose();
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
  out.J.middleCols<3>(layout.frame) = by_twist.template leftCols<3>();
  out.J.middleCols<3>(layout.frame + 3) =
      (by_twist.template rightCols<3>() - by_twist.template leftCols<3>() * skew<double>(Y.p - X_SM.p)) * turn_frame;
  // By X_TR, whose twist stands in T.
  const Mat3 R_ST = X_SM.R * X.R;
  out.J.middleCols<3>(layout.target) = by_twist.template leftCols<3>() * R_ST;
  out.J.middleCols<3>(layout.target + 3) =
      by_twist.template rightCols<3>() * R_ST * left_jacobian(Vec3(target[3], target[4], target[5]));
  // By p: the twist of T in M, taken to the target and into S.
  if (!out.by_parameters && (followed == nullptr || followed->by_pose)) return true;
  const Eigen::CompleteOrthogonalDecomposition<kinematics::ClosureMatrix> A(kinematics::closure_by_pose(m, X_A, q, p));
  if (followed != nullptr) {
    followed->X_MT = X_A;
    followed->by_pose.reset();
    if (at.converged) followed->by_pose = A;
  }
  if (!out.by_parameters) return true;
  const Eigen::MatrixXd F_p = layout.slots ? kinematics::closure_by_parameters(m, X_A, q, p, *layout.slots)
                                           : kinematics::closure_by_parameters(m, X_A, q, p);
  Mat6 to_target = Mat6::Zero();
  to_target.topLeftCorner<3, 3>() = X_SM.R;
  to_target.topRightCorner<3, 3>() = -X_SM.R * skew<double>(X.R * X_TR.p);
  to_target.bottomRightCorner<3, 3>() = X_SM.R;
  out.J.rightCols(F_p.cols()) = -(by_twist * to_target) * A.solve(F_p);
  return true;
}

/// Rules that the parameters keep among themselves (|u| = 1), as values that must be 0; none for most families.
template <class M>
std::vector<kinematics::Dual> rules_of(const M& m, std::span<const kinematics::Dual> p) {
  if constexpr (requires { parameter_rules(m, p); }) {
    return parameter_rules(m, p);
  } else {
    return {};
  }
}

/// Their values at the unknowns x, and the derivatives by all unknowns (rules x unknowns). Dual numbers carry six
/// derivatives at a time.
template <class M>
void rules_at(const M& m, const Layout& layout, const Eigen::VectorXd& x, Eigen::VectorXd& r, Eigen::MatrixXd& J) {
  constexpr int kAtATime = 6;
  const int count = layout.count - layout.parameters;
  std::vector<kinematics::Dual> p(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) p[static_cast<std::size_t>(i)] = kinematics::Dual(x[layout.parameters + i]);
  const auto rules = static_cast<Eigen::Index>(rules_of(m, std::span<const kinematics::Dual>(p)).size());
  r.setZero(rules);
  J.setZero(rules, layout.count);
  for (int first = 0; rules > 0 && first < count; first += kAtATime) {
    const int some = std::min(kAtATime, count - first);
    for (int j = 0; j < some; ++j) p[static_cast<std::size_t>(first + j)].v[j] = 1;
    const auto values = rules_of(m, std::span<const kinematics::Dual>(p));
    for (Eigen::Index i = 0; i < rules; ++i) {
      r[i] = values[static_cast<std::size_t>(i)].a;
      J.row(i).segment(layout.parameters + first, some) = values[static_cast<std::size_t>(i)].v.head(some).transpose();
    }
    for (int j = 0; j < some; ++j) p[static_cast<std::size_t>(first + j)].v.setZero();
  }
}

/// The same for a machine of any family, with its own pose of a row's joints as the drawing has it (nothing where it
/// does not assemble).
bool equations_of(const AnyMachine& machine, const Measurement& row, const Pose& seed_MT, const Layout& layout,
                  const Eigen::VectorXd& x, const Noise& noise, bool by_unknowns, Equations& out,
                  Lost lost = Lost::fail);
void rules_at(const AnyMachine& machine, const Layout& layout, const Eigen::VectorXd& x, Eigen::VectorXd& r,
              Eigen::MatrixXd& J);
std::optional<Pose> pose_of_row(const AnyMachine& machine, const Measurement& row);
kinematics::ParameterSlots parameter_slots_of(const AnyMachine& machine, const Pose& X_MT, const JointVector& q);
using kinematics::twist_by_parameters;

/// Trends and neighbours that are alike among the residuals, in the order of the rows or of their times; repeats at one
/// pose one after another are one point. `poses`: the pose of each row.
Drift drift_in(const std::vector<Measurement>& rows, const std::vector<std::size_t>& poses,
               const std::vector<RowResidual>& residuals);

/// What a calibration whose scores, noise and covariance are known is worth.
Verdict judged(const AnyMachine& nominal, const std::vector<Measurement>& rows, const Calibration& c,
               const std::vector<Systematic>& systematic);

/// A size of the machine, m: the largest of its lengths.
double size_of(const AnyMachine& machine);

/// Where the unknowns begin (the nominal parameters, the first guesses of frame and target, contacts at 0) and how far
/// each must be told: 1 % of the machine's size, or 0.01 rad.
struct Start {
  Eigen::VectorXd x, scale;
};
Start start_of(const AnyMachine& machine, const Layout& layout, const Pose& X_SM, const Pose& X_TR);

/// Which unknowns the equations can tell from those before them, in the order of the columns of J: unknown j is held
/// where a change by `scale[j]`, less the best that the others before it can do to look alike, stays below the noise
/// (one standard deviation over all equations) or below 1e-8 of its own effect. `ties[j]` of a held unknown are the
/// factors with which the others before it act like it: J_j = sum ties_k J_k.
struct Identifiability {
  std::vector<int> kept;                ///< columns, rising
  std::map<int, Eigen::VectorXd> ties;  ///< of every held column, over all columns
  double condition = 0;                 ///< of the kept columns, each scaled to unit length
};
Identifiability identifiable(const Eigen::MatrixXd& J, const std::vector<int>& order, const Eigen::VectorXd& scale);

}  // namespace polypod::calibration
