// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the closed inverses of arms with six joints share.
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>

#include "polypod/families/serial/kinematics.hpp"
#include "polypod/families/serial/spherical_wrist.hpp"

namespace polypod::machine::six {

// Axes meet, are parallel or square below this (m, rad): far above the rounding of degrees in files.
inline constexpr double kSame = 1e-9;
// What is beyond a boundary of reach by less than this part of the arm's size (squared) is on it: rounding.
inline constexpr double kStretched = 1e-14;
// A centre nearer to an axis, or two axes nearer in line: the angle is free (m, rad).
inline constexpr double kFree = 1e-12;
// A sine below this is 0 for the flag of branches that meet: the root of kStretched.
inline constexpr double kMeet = 1e-7;
// A solution that misses a limit by less than this keeps it (rad): rounding of the inverse.
inline constexpr double kLimitSlack = 1e-9;

/// The axes of the free joints in M at joint values 0: positive turns of a joint are positive turns about its axis.
struct Axes {
  std::array<Vec3, 6> direction, point;
  std::array<JointRange, 6> range;
  Pose X_0;  ///< X_MT there
};
/// Nothing unless six turning joints are free, none is coupled and a pose prescribes all six coordinates.
inline std::optional<Axes> axes_of(const SerialArm& arm) {
  if (arm.task != Task::pose || arm.free_joints() != 6 || arm.is_coupled()) return std::nullopt;
  Axes out;
  std::size_t next = 0;
  for (const DhRow& row : arm.dh) {
    if (row.locked) continue;
    if (row.kind != JointKind::revolute) return std::nullopt;
    out.range[next++] = row.range;
  }
  const ForwardJacobian at_zero = forward_jacobian(arm, JointVector::Zero(6));
  out.X_0 = at_zero.X_MT;
  for (std::size_t i = 0; i < 6; ++i) {
    const auto column = static_cast<Eigen::Index>(i);
    const Vec3 v = at_zero.J.col(column).head<3>(), w = at_zero.J.col(column).tail<3>();
    out.direction[i] = w;
    out.point[i] = out.X_0.p + w.cross(v);  // v = w x (p - o): the foot of the tip on the axis
  }
  return out;
}

/// A cosine and a sine, or a point of the arm's plane.
struct Complex {
  double re, im;
};
inline Complex operator*(const Complex& a, const Complex& b) {
  return {a.re * b.re - a.im * b.im, a.im * b.re + a.re * b.im};
}
inline Complex conjugate(const Complex& a) {
  return {a.re, -a.im};
}
inline double angle_of(const Complex& a) {
  return std::atan2(a.im, a.re);
}

/// The point that two lines share; nothing where they pass each other or are parallel.
inline std::optional<Vec3> common_point(const Vec3& o, const Vec3& u, const Vec3& p, const Vec3& v) {
  const Vec3 n = u.cross(v);
  const double square = n.squaredNorm();
  if (square < kSame) return std::nullopt;
  const Vec3 between = p - o;
  if (std::abs(between.dot(n)) > kSame * std::sqrt(square)) return std::nullopt;
  return o + u * (between.cross(v).dot(n) / square);
}

/// Upper arm and forearm at joints 0, of arms whose axes 2 and 3 are parallel and square to axis 1. In the arm's frame
/// A: z along axis 1 away from the base, y along axis 2 in either sense, the origin on axis 1 beside axis 2.
struct Links {
  Mat3 R_AM;
  Vec3 origin;           ///< of A, in M
  double sense_1 = 1;    ///< +1 or -1: axis 1 against z
  double a1 = 0, b = 0;  ///< m: axis 2 in front of axis 1; the point that joint 1 carries aside, off the plane y = 0
  double upper = 0, fore = 0;   ///< m, in that plane
  Complex upper_0{}, fore_0{};  ///< their directions (x, z)
  double bend = 0;              ///< rad, from upper to fore

  [[nodiscard]] Vec3 in_A(const Vec3& p_M) const { return R_AM * (p_M - origin); }
  /// +1 or -1: an axis along y against the turn from x to z, which is a negative one about y.
  [[nodiscard]] double sense(const Vec3& axis_M) const { return R_AM.row(1).dot(axis_M) > 0 ? -1 : 1; }
};
/// The links of `arm`, the forearm ending at `end`; x points to the side of axis 1 on which axis 2 stands, or, where
/// they meet, `carried`. Nothing where axes 1 to 3 stand otherwise, or a link has no length.
inline std::optional<Links> links_of(const SerialArm& arm, const Axes& axes, const Vec3& carried, const Vec3& end) {
  const auto& w = axes.direction;
  const auto& o = axes.point;
  if (w[1].cross(w[2]).norm() > kSame || std::abs(w[0].dot(w[1])) > kSame) return std::nullopt;
  Links out;
  Vec3 up = w[0];
  if (up.dot(arm.X_MB.R.col(2)) < 0) up = -up;
  out.sense_1 = up.dot(w[0]) > 0 ? 1 : -1;
  Vec3 front = w[1].cross(up).normalized();
  double side = front.dot(o[1] - o[0]);
  if (std::abs(side) < kSame) side = front.dot(carried - o[0]);
  if (side < 0) front = -front;
  out.R_AM.row(0) = front;
  out.R_AM.row(1) = up.cross(front);
  out.R_AM.row(2) = up;
  out.origin = o[0] + up * up.dot(o[1] - o[0]);
  out.a1 = out.in_A(o[1]).x();
  out.b = out.in_A(carried).y();
  if (std::abs(out.b) < kFree) out.b = 0;
  const Vec3 upper = out.in_A(o[2]) - out.in_A(o[1]), fore = out.in_A(end) - out.in_A(o[2]);
  out.upper = std::hypot(upper.x(), upper.z());
  out.fore = std::hypot(fore.x(), fore.z());
  if (out.upper < kSame || out.fore < kSame) return std::nullopt;
  out.upper_0 = {upper.x() / out.upper, upper.z() / out.upper};
  out.fore_0 = {fore.x() / out.fore, fore.z() / out.fore};
  out.bend = angle_of(out.fore_0 * conjugate(out.upper_0));
  return out;
}

inline Mat3 turn(const Vec3& axis, double angle) {
  return Eigen::AngleAxisd(angle, axis).toRotationMatrix();
}

/// The angle about `axis` that takes `from` into the half plane of `to` (Paden 1986, subproblem 1). By the parts square
/// to the axis, which keep their digits where both directions lie next to it.
inline double angle_between(const Vec3& axis, const Vec3& from, const Vec3& to) {
  const Vec3 a = axis.cross(from), b = axis.cross(to);
  return std::atan2(axis.dot(a.cross(b)), a.dot(b));
}

/// Three turns R = R_4 R_5 R_6 about the directions u, v and w, any angles between u and v, and v and w, but 0.
struct Turns {
  Vec3 u, v, w;
  double a = 0, b = 0;  ///< the angles between u and v, v and w
  double middle = 0;    ///< angle 5 where u and R_5 w are nearest to each other

  Turns() = default;
  Turns(const Vec3& first, const Vec3& second, const Vec3& third) : u(first), v(second), w(third) {
    a = std::atan2(u.cross(v).norm(), u.dot(v));
    b = std::atan2(v.cross(w).norm(), v.dot(w));
    middle = std::atan2(u.dot(v.cross(w)), u.dot(w) - u.dot(v) * v.dot(w));
  }

  struct Solution {
    double q4[2], q5[2], q6[2];  ///< angle 5 above `middle`, and below
    bool in_line;                ///< u and R w are in line: angle 4 is free
  };
  /// Both solutions for R. The spherical triangle with the sides a, b and c = angle(u, R w) has at v the angle x with
  ///   tan^2(x / 2) = sin((c + a - b) / 2) sin((c - a + b) / 2) / (sin((a + b + c) / 2) sin((a + b - c) / 2)),
  /// which loses no digits where u and R w are nearly in line. Nothing where c lies outside of |a - b| .. a + b. Free
  /// is angle 4, then `free4`, or angle 6 if `free6` is given.
  [[nodiscard]] std::optional<Solution> solve(const Mat3& R, double free4, const double* free6 = nullptr) const {
    const Vec3 target = R * w;
    const double c = std::atan2(u.cross(target).norm(), u.dot(target));
    const double over = std::sin((c + a - b) / 2) * std::sin((c - a + b) / 2);
    const double under = std::sin((a + b + c) / 2) * std::sin((a + b - c) / 2);
    if (over < -kStretched || under < -kStretched) return std::nullopt;
    const double half = 2 * std::atan2(std::sqrt(std::max(0.0, over)), std::sqrt(std::max(0.0, under)));
    Solution out{};
    out.in_line = std::min(c, std::numbers::pi - c) < kFree;
    // A direction off w, to measure angle 6 by, and one off u for angle 4.
    const Vec3 beside_w = std::abs(w.dot(v)) < 0.9 ? v : u, beside_u = std::abs(u.dot(v)) < 0.9 ? v : w;
    for (int f = 0; f < 2; ++f) {
      out.q5[f] = middle + (f == 0 ? half : -half);
      const Mat3 R5 = turn(v, out.q5[f]);
      if (out.in_line && free6 != nullptr) {
        out.q6[f] = *free6;
        const Mat3 rest = R * (R5 * turn(w, *free6)).transpose();
        out.q4[f] = angle_between(u, beside_u, rest * beside_u);
        continue;
      }
      out.q4[f] = out.in_line ? free4 : angle_between(u, R5 * w, target);
      const Mat3 rest = (turn(u, out.q4[f]) * R5).transpose() * R;
      out.q6[f] = angle_between(w, beside_w, rest * beside_w);
    }
    return out;
  }
};

/// q + 2 pi k within low .. high for the k nearest to 0, else q.
inline double in_some_turn(double q, double low, double high) {
  constexpr double kTurn = 2 * std::numbers::pi;
  const double up = std::max(0.0, std::ceil((low - q) / kTurn)), down = std::max(0.0, std::ceil((q - high) / kTurn));
  const double turned = q + kTurn * (up - down);
  return turned >= low && turned <= high ? turned : q;
}

/// The turn of `angle` (at most 3 pi) that lies in the range if there is one, else the one in (-pi, pi]; of several in
/// the range the nearest to reference[joint] if there is a reference. Without branches but for the reference, and
/// ranges that begin more than half a turn off.
inline double in_range(double angle, const JointRange& range, const double* reference, int joint) {
  constexpr double kTurn = 2 * std::numbers::pi;
  const double low = range.min - kLimitSlack, high = range.max + kLimitSlack;
  double q = angle;
  q -= q > std::numbers::pi ? kTurn : 0.0;
  q += q < -std::numbers::pi ? kTurn : 0.0;
  // Not &&, which branches.
  q -= static_cast<int>(q > high) & static_cast<int>(q - kTurn >= low) ? kTurn : 0.0;
  q += static_cast<int>(q < low) & static_cast<int>(q + kTurn <= high) ? kTurn : 0.0;
  if (low > std::numbers::pi || high < -std::numbers::pi) q = in_some_turn(q, low, high);
  if (reference == nullptr || range.max - range.min < kTurn) return q;
  double near = q + kTurn * std::round((reference[joint] - q) / kTurn);
  if (near > high) near -= kTurn;
  if (near < low) near += kTurn;
  return near >= low && near <= high ? near : q;
}

/// Two bits a joint; of machines with fewer joints those of the first `joints`.
inline kinematics::LimitBits violations(const std::array<JointRange, 6>& range, const double* q,
                                        std::size_t joints = 6) {
  kinematics::LimitBits bits = 0;
  for (std::size_t i = 0; i < joints; ++i) {
    bits |= kinematics::LimitBits{q[i] < range[i].min - kLimitSlack} << (2 * i);
    bits |= kinematics::LimitBits{q[i] > range[i].max + kLimitSlack} << (2 * i + 1);
  }
  return bits;
}

inline kinematics::InverseResult result(const SixJointBranches& branches, const std::array<JointRange, 6>& range,
                                        const char* why_none) {
  kinematics::InverseResult out;
  out.solutions.reserve(SixJointBranches::kCount);
  for (int k = 0; k < SixJointBranches::kCount; ++k) {
    if (!branches.exists[k]) continue;
    const double* q = branches.joints[k];
    out.solutions.push_back(
        {Eigen::Map<const Eigen::Matrix<double, 6, 1>>(q), unsigned(k), violations(range, q), branches.singular[k]});
  }
  if (out.solutions.empty()) out.reason = why_none;
  return out;
}

}  // namespace polypod::machine::six
