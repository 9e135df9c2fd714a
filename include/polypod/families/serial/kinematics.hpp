// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Serial arms: chain, closure, limits, Jacobian, inverse. The functions stand in the namespace of the family's struct,
// so that the analyses find them by argument-dependent lookup.
#pragma once

#include <algorithm>
#include <array>
#include <span>
#include <string>
#include <vector>

#include "polypod/families/serial/machine.hpp"
#include "polypod/kinematics/concept.hpp"

namespace polypod::machine {

using kinematics::InverseResult;
using kinematics::LimitBits;

inline int joint_count(const SerialArm& arm) {
  return arm.free_joints();
}
JointKind joint_kind(const SerialArm& arm, int joint);
JointRange joint_range(const SerialArm& arm, int joint);
inline Task task(const SerialArm& arm) {
  return arm.task;
}
namespace serial_detail {
/// R <- R times a rotation about axis k by an angle of this cosine and sine: its columns i = k + 1 and j = k + 2 turn.
template <class T, class P>
void turn_columns(Matrix3<T>& R, int i, int j, const P& c, const P& s) {
  for (int k = 0; k < 3; ++k) {
    const T a = R(k, i), b = R(k, j);
    R(k, i) = a * c + b * s;
    R(k, j) = b * c - a * s;
  }
}
/// X <- X times a motion along axis k.
template <class T, class P>
void slide_along(PoseT<T>& X, int k, const P& by) {
  for (int i = 0; i < 3; ++i) X.p[i] += X.R(i, k) * by;
}
}  // namespace serial_detail

/// X_MT(q; p) = X_MB A_1 ... A_n X_FT on any number type; p holds a, alpha, d, theta_offset of each row, SI, and q the
/// free joints (SLAV (2.13), (2.16)), p on the same number type or plain numbers; each_row(X) takes the frame of each
/// row. A_i is a turn about x by alpha after a move by a, and a turn about z by theta after a move by d: these first
/// where the convention is the standard one. Cost: 4 sines and cosines and 30 products a row.
template <class T, class P, class EachRow>
PoseT<T> chain(const SerialArm& arm, std::span<const T> q, std::span<const P> p, EachRow&& each_row) {
  using std::cos, std::sin;
  PoseT<T> X = arm.X_MB.cast<T>();
  const auto move = [&X](int axis, const auto& by, const auto& angle) {
    serial_detail::slide_along(X, axis, by);
    serial_detail::turn_columns(X.R, (axis + 1) % 3, (axis + 2) % 3, std::decay_t<decltype(angle)>(cos(angle)),
                                std::decay_t<decltype(angle)>(sin(angle)));
  };
  std::size_t next = 0;
  // The joint of a row before.
  const auto value_of = [&](std::size_t of) {
    const auto before = arm.dh.begin() + static_cast<std::ptrdiff_t>(of);
    if (before->locked) return T(*before->locked);
    return q[static_cast<std::size_t>(std::count_if(arm.dh.begin(), before, [](const DhRow& r) { return !r.locked; }))];
  };
  for (std::size_t i = 0; i < arm.dh.size(); ++i) {
    const DhRow& row = arm.dh[i];
    const P &a = p[4 * i], &alpha = p[4 * i + 1], &d = p[4 * i + 2], &theta = p[4 * i + 3];
    const T value = row.locked ? T(*row.locked) : q[next++];
    const bool standard = arm.convention == DhConvention::standard;
    if (!standard) move(0, a, alpha);
    if (row.kind == JointKind::revolute) {
      T angle = T(T(theta) + T(row.sign) * value);
      if (row.coupled_back > 0)
        angle = T(angle + T(row.coupling) * value_of(i - static_cast<std::size_t>(row.coupled_back)));
      move(2, d, angle);
    } else {
      move(2, T(T(d) + T(row.sign) * value), theta);
    }
    if (standard) move(0, a, alpha);
    each_row(X);
  }
  return X * arm.X_FT.cast<T>();
}
template <class T, class P>
PoseT<T> chain(const SerialArm& arm, std::span<const T> q, std::span<const P> p) {
  return chain(arm, q, p, [](const PoseT<T>&) {});
}

/// The closure of a serial arm is the pose error of its chain, 6 equations:
///   F = [ p_X - p(q) ; 1/2 sum_k r_k(q) x x_k ],
/// x_k and r_k the columns of the two rotations. The second half is sin(angle) times the axis of R_X R(q)^T: zero for
/// equal rotations (and for half turns, which forward kinematics never meets); its derivative by the rotation vector of
/// X is the identity at a solution, so A = 1 there and J = -B.
template <class T, class P>
ClosureVectorT<T> closure(const SerialArm& arm, const PoseT<T>& X_MT, std::span<const T> q, std::span<const P> p) {
  const PoseT<T> X = chain(arm, q, p);
  ClosureVectorT<T> F(6);
  Vector3<T> turn = Vector3<T>::Zero();
  for (int k = 0; k < 3; ++k) {
    const Vector3<T> r = X.R.col(k), x = X_MT.R.col(k);
    turn += Vector3<T>(r.y() * x.z() - r.z() * x.y(), r.z() * x.x() - r.x() * x.z(), r.x() * x.y() - r.y() * x.x());
  }
  for (int i = 0; i < 3; ++i) {
    F[i] = X_MT.p[i] - X.p[i];
    F[3 + i] = T(0.5) * turn[i];
  }
  return F;
}

/// F_X = 1 at a solution, so that F_q = -jacobian(m, X, q) there, and X = chain(m, q, p).
constexpr void closure_is_pose_error(const SerialArm&) {}

/// The limits of a serial arm: q - min and max - q of every free joint, in that order.
template <class T>
std::vector<T> limits(const SerialArm& arm, const PoseT<T>&, std::span<const T> q, std::span<const T>) {
  std::vector<T> g;
  std::size_t next = 0;
  for (const DhRow& row : arm.dh) {
    if (row.locked) continue;
    g.push_back(q[next] - T(row.range.min));
    g.push_back(T(row.range.max) - q[next]);
    ++next;
  }
  return g;
}

/// "joint 2 below its minimum", ...
std::string limit_name(const SerialArm& arm, int limit);
/// Two a free joint, whose number is the group. Angles count on the sum of all lengths.
LimitTable limit_table(const SerialArm& arm);

/// X_MT of the free joints q. One solution always. Cost: about 0.1 us for five joints.
Pose forward(const SerialArm& arm, const JointVector& q);

struct ForwardJacobian {
  Pose X_MT;
  /// Columns [k x (p_T - o); k] (revolute) or [k; 0] (prismatic), k and o the axis and origin of frame i - 1 in M
  /// (SLAV (2.38); (2.37) is misprinted), times the sign of the joint; and of a joint that turns further rows, the
  /// same of those, times their coupling. One column a row of the table if `locked_too`.
  JacobianMatrix J;
};
/// Forward kinematics and geometric Jacobian in one pass. With `locked_too` the Jacobian has a column for every row of
/// the table, for statics with a compliant brake.
ForwardJacobian forward_jacobian(const SerialArm& arm, const JointVector& q, bool locked_too = false);

JacobianMatrix jacobian(const SerialArm& arm, const Pose& X_MT, const JointVector& q);

/// What the tool does for a unit of each Denavit-Hartenberg parameter, 6 x 4 rows in the order of `parameters` (a,
/// alpha, d, theta_offset): a row's a and d shift along its x and z, alpha and theta turn about them; in M, at the tip.
/// The same as -A^-1 F_p of the closure, in closed form. Cost: 0.4 us for six rows.
Eigen::Matrix<double, 6, Eigen::Dynamic> parameter_columns(const SerialArm& arm, const JointVector& q);

/// All inverse solutions of the task for the pose X_MT (for Task::axis only the position and the third column count).
///
/// Closed forms, of whatever table has the axes for it, with up to eight branches:
/// - five free joints, the wrist of LOLA 50 (standard table, alpha = 90, 0, 90, -90, a_3 = 0, joints 4 and 5 cutting in
///   a point on the line of the tool axis, further joints locked): WristInverse, SLAV (2.18) to (2.34), flipped for
///   cos(theta_5) < 0. Where the wrist centre is on axis 1, or the tool axis along joint 4, the free joint is 0 and the
///   solution marked singular;
/// - six free joints and a spherical wrist, axes 2 and 3 parallel and square to axis 1: SphericalWristInverse;
/// - six free joints, axes 2, 3 and 4 parallel and square to axis 1, axes 5 and 6 meeting: ThreeParallelInverse;
/// - a spherical wrist behind any other first three axes: PieperInverse; linear axes: CartesianInverse; ScaraInverse.
/// Of joints that are coupled, that of the arm without coupling, from whose joints theirs follow one after the other.
/// One freedom more over such a form (names_branches): one solution a branch; other arms: inverse_damped. All joints
/// are in the turn within their ranges (of several, that in (-180, 180] deg); inverse_near chooses between several
/// turns.
InverseResult inverse(const SerialArm& arm, const Pose& X_MT);
/// `front|back elbow-up|elbow-down [wrist-flipped]` of the closed forms, in the order of WristInverse; `arm-1` to
/// `arm-4 [wrist-flipped]` of PieperInverse; `tilt-positive`, `tilt-negative` of CartesianInverse; else "numeric-1"...
std::string branch_name(const SerialArm& arm, unsigned branch);

/// For pose after pose of one arm with a closed form: the first solution of inverse() within the limits, nothing where
/// there is none. What follows from the table alone is worked out once. Empty where the arm has no closed form.
std::function<std::optional<JointVector>(const Pose& X_MT)> joint_finder(const SerialArm& arm);

/// The solution next to `start` by damped Newton steps from there: the same posture on the way along a path. At most
/// one; none where the steps do not converge.
InverseResult inverse_from(const SerialArm& arm, const Pose& X_MT, const JointVector& start);

/// Whether a solution keeps the limits `heeded`: of inverse(), or (arms without a closed form) the first of its
/// searches that does, each of at most 60 steps; no where the first eight find nothing at all.
bool reaches(const SerialArm& arm, const Pose& X_MT, LimitBits heeded);

/// All solutions as inverse() gives them, seen from the joints `last` (closed forms with six joints): of several turns
/// within the range the nearest to `last`, and at a singular pose the free joint keeps its value there, so that the
/// joints stay continuous along a path that leads over the pose. Without a closed form: inverse_from.
InverseResult inverse_near(const SerialArm& arm, const Pose& X_MT, const JointVector& last);

/// Whether inverse() is in closed form for this arm.
bool has_closed_inverse(const SerialArm& arm);
/// Whether its solutions have the names of a closed form: also of an arm that a further joint carries, and of one with
/// six joints whose turn about the tool axis is free.
bool names_branches(const SerialArm& arm);

/// The closed inverse with everything that depends on the table alone worked out once, for inner loops.
class WristInverse {
 public:
  /// Empty if the arm has no such form.
  static Result<WristInverse> of(const SerialArm& arm);

  static constexpr int kBranches = 8;
  struct Branches {
    JointVector joints[kBranches];
    bool exists[kBranches] = {};  ///< the target is within reach on this branch
    bool singular[kBranches] = {};
  };
  /// Tip position and unit tool axis in M -> all branches, order: front/back (4), elbow-up/down (2), wrist/flipped (1).
  /// Cost: 0.3 us.
  void solve(const Vec3& p_M, const Vec3& k_M, Branches& out) const;

  /// The first branch whose joints keep all ranges, as an index, or -1.
  [[nodiscard]] int first_within_limits(const Branches& branches) const;
  [[nodiscard]] LimitBits violations(const JointVector& q) const;

  /// The numbers of the closed form, for bounds over boxes of poses: X_BM, the lengths of SLAV (2.18) to (2.22), the
  /// angle of the tool axis about joint 5, and per joint the sense, offset and range; angle t_i = sign_i q_i +
  /// offset_i.
  struct Form {
    Pose X_BM;
    double a1 = 0, d1 = 0, a2 = 0, d4 = 0, reach = 0, axis_angle = 0;
    std::array<double, 5> sign{}, offset{}, min{}, max{};
  };
  [[nodiscard]] Form form() const {
    Form f{X_BM_, a1_, d1_, a2_, d4_, reach_, axis_angle_, {}, {}, {}, {}};
    for (std::size_t i = 0; i < 5; ++i) {
      f.sign[i] = sign_[i];
      f.offset[i] = offset_[i];
      f.min[i] = min_[i];
      f.max[i] = max_[i];
    }
    return f;
  }

 private:
  Pose X_BM_;
  double a1_ = 0, d1_ = 0, a2_ = 0, d4_ = 0, reach_ = 0, axis_angle_ = 0;
  double sign_[5] = {}, offset_[5] = {}, min_[5] = {}, max_[5] = {};
};

static_assert(kinematics::Machine<SerialArm>);

}  // namespace polypod::machine
