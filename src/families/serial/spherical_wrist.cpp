// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/serial/spherical_wrist.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <optional>

#include "polypod/families/serial/kinematics.hpp"

namespace polypod::machine {
namespace {

constexpr double kPi = std::numbers::pi;
// Axes meet, are parallel or square below this (m, rad): far above the rounding of degrees in files.
constexpr double kSame = 1e-9;
// A cosine beyond 1 by less than this is 1: rounding where the arm is stretched.
constexpr double kStretched = 1e-12;
// A wrist centre nearer to axis 1, or axes 4 and 6 nearer in line: the angle is free (m, rad).
constexpr double kFree = 1e-9;

Mat3 turn(const Vec3& axis, double angle) {
  return Eigen::AngleAxisd(angle, axis).toRotationMatrix();
}

/// The angle about `axis` that takes `from` into the half plane of `to` (Paden's subproblem 1).
double angle_between(const Vec3& axis, const Vec3& from, const Vec3& to) {
  return std::atan2(axis.dot(from.cross(to)), from.dot(to) - axis.dot(from) * axis.dot(to));
}

/// Both angles x with normal . turn(axis, x) v = value; nothing where none reaches it.
struct TwoAngles {
  double angle[2];
};
std::optional<TwoAngles> angles_to_height(const Vec3& normal, const Vec3& axis, const Vec3& v, double value) {
  // normal . turn v = (n.a)(v.a) + A cos x + B sin x
  const double along = normal.dot(axis) * v.dot(axis);
  const double A = normal.dot(v) - along, B = normal.dot(axis.cross(v));
  const double size = std::hypot(A, B);
  const double cosine = (value - along) / size;
  if (!(size > 0) || std::abs(cosine) > 1 + kStretched) return std::nullopt;
  const double middle = std::atan2(B, A), half = std::acos(std::clamp(cosine, -1.0, 1.0));
  return TwoAngles{{middle + half, middle - half}};
}

/// The point that two lines share; nothing where they pass each other or are parallel.
std::optional<Vec3> common_point(const Vec3& o, const Vec3& u, const Vec3& p, const Vec3& v) {
  const Vec3 n = u.cross(v);
  const double square = n.squaredNorm();
  if (square < kSame) return std::nullopt;
  const Vec3 between = p - o;
  if (std::abs(between.dot(n)) > kSame * std::sqrt(square)) return std::nullopt;
  return o + u * (between.cross(v).dot(n) / square);
}

/// The turn of the angle that lies in the range; the nearest to its middle where several do.
double in_range(double angle, const JointRange& range) {
  double q = std::remainder(angle, 2 * kPi);
  if (q > range.max + kSame && q - 2 * kPi >= range.min - kSame) q -= 2 * kPi;
  if (q < range.min - kSame && q + 2 * kPi <= range.max + kSame) q += 2 * kPi;
  return q;
}

}  // namespace

std::optional<SphericalWristInverse> SphericalWristInverse::of(const SerialArm& arm) {
  if (arm.dh.size() != 6 || arm.task != Task::pose) return std::nullopt;
  for (const DhRow& row : arm.dh)
    if (row.kind != JointKind::revolute || row.locked) return std::nullopt;
  SphericalWristInverse out;
  const JointVector zero = JointVector::Zero(6);
  const ForwardJacobian at_zero = forward_jacobian(arm, zero);
  out.X_0_inverse_ = at_zero.X_MT.inverse();
  for (int i = 0; i < 6; ++i) {
    const Vec3 v = at_zero.J.col(i).head<3>(), w = at_zero.J.col(i).tail<3>();
    // v = w x (p - o): the foot of the tip on the axis.
    out.joints_[std::size_t(i)] = {w, at_zero.X_MT.p + w.cross(v), joint_range(arm, i)};
  }
  const auto& j = out.joints_;
  const auto wrist = common_point(j[4].point, j[4].axis, j[5].point, j[5].axis);
  if (!wrist || (*wrist - j[3].point).cross(j[3].axis).norm() > kSame) return std::nullopt;
  const auto square = [](const Vec3& a, const Vec3& b) { return std::abs(a.dot(b)) < kSame; };
  const bool parallel = j[1].axis.cross(j[2].axis).norm() < kSame;
  if (!parallel || !square(j[0].axis, j[1].axis) || !square(j[3].axis, j[4].axis) || !square(j[4].axis, j[5].axis)) {
    return std::nullopt;
  }
  out.wrist_ = *wrist;
  // The elbow's and the forearm's lengths in the arm's plane must be there.
  const auto flat = [&](const Vec3& v) { return Vec3(v - j[1].axis * j[1].axis.dot(v)); };
  if (flat(j[2].point - j[1].point).norm() < kSame || flat(*wrist - j[2].point).norm() < kSame) return std::nullopt;
  out.up_ = j[0].axis;
  if (out.up_.dot(arm.X_MB.R.col(2)) < 0) out.up_ = -out.up_;
  out.front_ = j[1].axis.cross(out.up_);
  double side = out.front_.dot(j[1].point - j[0].point);
  if (std::abs(side) < kSame) side = out.front_.dot(*wrist - j[0].point);
  if (side < 0) out.front_ = -out.front_;
  return out;
}

kinematics::InverseResult SphericalWristInverse::solve(const Pose& X_MT) const {
  const auto& j = joints_;
  kinematics::InverseResult out;
  const Pose T = X_MT * X_0_inverse_;
  const Vec3 c = T * wrist_, from_1 = c - j[0].point;
  const bool over_axis = from_1.cross(j[0].axis).norm() < kFree;
  // The wrist stands off the plane through axis 1 by what axis 2 is shifted along itself.
  const double aside = j[1].axis.dot(wrist_ - j[0].point);
  TwoAngles first{{0, 0}};
  if (!over_axis) {
    // w_2 . e_1^-1 v = value, so turn the other way.
    const auto found = angles_to_height(j[1].axis, -j[0].axis, from_1, aside);
    if (!found) {
      out.reason = "the wrist centre is nearer to axis 1 than its offset from the arm's plane";
      return out;
    }
    first = *found;
  }
  struct Shoulder {
    double q1 = 0;
    Vec3 c;  ///< the wrist centre turned back into the plane of joint 1 at 0
  };
  Shoulder shoulders[2];
  for (int k = 0; k < 2; ++k) shoulders[k] = {first.angle[k], j[0].point + turn(j[0].axis, -first.angle[k]) * from_1};
  if (front_.dot(shoulders[0].c - j[0].point) < front_.dot(shoulders[1].c - j[0].point)) {
    std::swap(shoulders[0], shoulders[1]);
  }
  const Vec3& axis = j[1].axis;
  const auto flat = [&](const Vec3& v) { return Vec3(v - axis * axis.dot(v)); };
  const Vec3 upper = flat(j[2].point - j[1].point), fore = flat(wrist_ - j[2].point);
  for (int elbow = 0; elbow < 2; ++elbow) {
    for (int back = 0; back < (over_axis ? 1 : 2); ++back) {
      const Vec3 to_wrist = flat(shoulders[back].c - j[1].point);
      // |upper + e_3 fore|^2 = |to_wrist|^2
      const double wanted = 0.5 * (to_wrist.squaredNorm() - upper.squaredNorm() - fore.squaredNorm());
      const auto third = angles_to_height(upper, j[2].axis, fore, wanted);
      if (!third) continue;
      for (const double q3 : third->angle) {
        const Vec3 reach = upper + turn(j[2].axis, q3) * fore;
        const double q2 = angle_between(axis, reach, to_wrist);
        const Vec3 elbow_at = turn(axis, q2) * upper;
        // Above the line from axis 2 to the wrist, seen with the wrist on the right. On the line: both are the same.
        const Vec3 right = back == 0 ? front_ : Vec3(-front_);
        const double above = right.dot(to_wrist) * up_.dot(elbow_at) - up_.dot(to_wrist) * right.dot(elbow_at);
        const bool up = std::abs(above) < kFree * kFree ? q3 == third->angle[0] : above > 0;
        if (up != (elbow == 0)) continue;
        const double q1 = shoulders[back].q1;
        const Mat3 R = (turn(j[0].axis, q1) * turn(axis, q2) * turn(j[2].axis, q3)).transpose() * T.R;
        wrist(R, q1, q2, q3, over_axis, unsigned(4 * elbow + 2 * back), out);
      }
    }
  }
  if (out.solutions.empty() && out.reason.empty()) out.reason = "the wrist centre is out of reach of the two links";
  return out;
}

void SphericalWristInverse::wrist(const Mat3& R, double q1, double q2, double q3, bool over_axis, unsigned branch,
                                  kinematics::InverseResult& out) const {
  const auto& j = joints_;
  const Vec3 &w4 = j[3].axis, &w5 = j[4].axis, &w6 = j[5].axis, target = R * w6;
  // Square axes: w_4 . R_5 w_6 = cos(q5 - middle). An arc cosine would lose half of the digits where 4 and 6 are in
  // line.
  const double middle = std::atan2(w4.dot(w5.cross(w6)), w4.dot(w6));
  const double half = std::atan2(w4.cross(target).norm(), w4.dot(target));
  for (int flipped = 0; flipped < 2; ++flipped) {
    const double q5 = flipped == 0 ? middle + half : middle - half;
    const Vec3 turned = turn(w5, q5) * w6;
    const bool in_line = turned.cross(w4).norm() < kFree;
    const double q4 = in_line ? 0 : angle_between(w4, turned, target);
    const Mat3 rest = (turn(w4, q4) * turn(w5, q5)).transpose() * R;
    const double q6 = angle_between(w6, w5, rest * w5);
    kinematics::Solution s;
    s.joints.resize(6);
    const double angles[6] = {q1, q2, q3, q4, q5, q6};
    for (int i = 0; i < 6; ++i) {
      const JointRange& range = j[std::size_t(i)].range;
      s.joints[i] = in_range(angles[i], range);
      if (s.joints[i] < range.min - kSame) s.violations |= kinematics::LimitBits{1} << (2 * i);
      if (s.joints[i] > range.max + kSame) s.violations |= kinematics::LimitBits{1} << (2 * i + 1);
    }
    s.branch = branch + unsigned(flipped);
    s.singular = over_axis || in_line;
    out.solutions.push_back(std::move(s));
  }
}

}  // namespace polypod::machine
