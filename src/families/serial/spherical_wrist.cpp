// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/serial/spherical_wrist.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "polypod/families/serial/kinematics.hpp"
#include "polypod/geometry/trigonometry.hpp"
#include "six_joints.hpp"

namespace polypod::machine {
namespace {

constexpr double kPi = std::numbers::pi;
using six::Complex, six::conjugate;
using six::kFree, six::kMeet, six::kSame, six::kStretched;

}  // namespace

std::optional<SphericalWristInverse> SphericalWristInverse::of(const SerialArm& arm) {
  const std::optional<six::Axes> axes = six::axes_of(arm);
  if (!axes) return std::nullopt;
  const auto& [w, o, range, X_0] = *axes;
  const auto wrist = six::common_point(o[4], w[4], o[5], w[5]);
  if (!wrist || (*wrist - o[3]).cross(w[3]).norm() > kSame) return std::nullopt;
  if (w[3].cross(w[4]).norm() < kSame) return std::nullopt;
  const auto links = six::links_of(arm, *axes, *wrist, *wrist);
  if (!links) return std::nullopt;
  SphericalWristInverse out;
  out.range_ = range;
  out.R_AM_ = links->R_AM;
  out.p_AM_ = -(links->R_AM * links->origin);
  out.a1_ = links->a1;
  out.b_ = links->b;
  out.upper_ = links->upper;
  out.fore_ = links->fore;
  out.upper_c_ = links->upper_0.re;
  out.upper_s_ = links->upper_0.im;
  out.fore_c_ = links->fore_0.re;
  out.fore_s_ = links->fore_0.im;
  out.bend_ = links->bend;
  out.sense_ = {links->sense_1, links->sense(w[1]), links->sense(w[2])};

  const Mat3 R_TM = X_0.R.transpose();
  out.wrist_T_ = R_TM * (*wrist - X_0.p);
  const Vec3 w4 = out.R_AM_ * w[3], w5 = out.R_AM_ * w[4], w6 = out.R_AM_ * w[5];
  const six::Turns turns(w4, w5, w6);
  out.middle_ = turns.middle;
  out.swapped_ = kPi - std::abs(out.middle_) < kSame;
  out.right_angled_ = std::abs(w[3].dot(w[4])) < kSame && std::abs(w[4].dot(w[5])) < kSame;
  if (out.right_angled_) {
    out.lead_ << w5.cross(w4), w5, w4;
    Mat3 last;
    last << w[4].cross(w[5]), w[4], w[5];
    out.tool_ = R_TM * last;
  } else {
    out.lead_ << w4, w5, w6;
    out.tool_ = R_TM * out.R_AM_.transpose();
  }
  return out;
}

void SphericalWristInverse::solve(const Pose& X_MT, Branches& out, const double* reference) const {
  // The directions of all angles: joint 1 (front, back); g and joint 2 of both shoulders and elbows; joints 4 to 6 of
  // each.
  enum : int { kFirst = 0, kBend = 2, kSecond = 4, kWrist = 8 };
  double y[20], x[20], angle[20];
  const Vec3 c = R_AM_ * (X_MT.R * wrist_T_ + X_MT.p) + p_AM_;
  const double size2 = square(upper_ + fore_ + std::abs(a1_)) + b_ * b_;
  const double r2 = square(c.x()) + square(c.y()), rho2 = r2 - b_ * b_;
  for (int k = 0; k < Branches::kCount; ++k) out.exists[k] = out.singular[k] = false;
  if (rho2 < -kStretched * size2) return;
  const double rho = std::sqrt(std::max(0.0, rho2));
  const bool over_axis = r2 < kFree * kFree;
  const double over_r2 = over_axis ? 0.0 : 1 / r2;
  const bool beside = rho2 < kStretched * size2;
  const double over_twice = 1 / (2 * upper_ * fore_);
  const Mat3 N = R_AM_ * X_MT.R * tool_;
  const Complex upper_0{upper_c_, upper_s_}, fore_0{fore_c_, fore_s_};
  bool reached[2] = {}, in_line[2][2] = {}, folded[2] = {}, met[2] = {};
  six::Turns::Solution oblique[2][2];  // wrists that are not right-angled, where `oriented`
  bool oriented[2][2];
  for (int s = 0; s < 2; ++s) {
    const double side = s == 0 ? rho : -rho;
    Complex t1{1, 0};
    if (!over_axis) {
      t1 = {(side * c.x() + b_ * c.y()) * over_r2, (side * c.y() - b_ * c.x()) * over_r2};
    } else if (reference != nullptr) {
      t1 = {std::cos(reference[0]), sense_[0] * std::sin(reference[0])};
    } else if (s == 1) {
      t1 = {-1, 0};
    }
    x[kFirst + s] = t1.re;
    y[kFirst + s] = t1.im;
    const Complex P{side - a1_, c.z()};
    const double D2 = square(P.re) + square(P.im);
    const double far = square(upper_ + fore_) - D2, near = D2 - square(upper_ - fore_);
    reached[s] = far >= -kStretched * size2 && near >= -kStretched * size2;
    if (!reached[s]) {  // every direction is one
      for (const int k : {kBend + s, kSecond + 2 * s, kSecond + 2 * s + 1}) x[k] = y[k] = 0;
      for (int k = kWrist + 6 * s; k < kWrist + 6 * s + 6; ++k) x[k] = y[k] = 0;
      continue;
    }
    const double cg = std::clamp((D2 - upper_ * upper_ - fore_ * fore_) * over_twice, -1.0, 1.0);
    const double sg = std::sqrt(std::max(0.0, far) * std::max(0.0, near)) * over_twice;
    folded[s] = D2 < kFree * kFree;
    const double over_D2 = folded[s] ? 0.0 : 1 / D2;
    met[s] = sg < kMeet;
    x[kBend + s] = cg;
    y[kBend + s] = sg;
    // Turned back by joint 1.
    const Eigen::RowVector3d n0 = t1.re * N.row(0) + t1.im * N.row(1), n1 = t1.re * N.row(1) - t1.im * N.row(0),
                             n2 = N.row(2);
    for (int e = 0; e < 2; ++e) {
      const Complex bend{cg, s == e ? -sg : sg};
      Complex upper;
      if (!folded[s]) {
        const Complex E{upper_ + fore_ * bend.re, fore_ * bend.im};
        upper = P * conjugate(E);
        upper = {upper.re * over_D2, upper.im * over_D2};
      } else {
        const double t2 = reference != nullptr ? sense_[1] * reference[1] : 0.0;
        upper = upper_0 * Complex{std::cos(t2), std::sin(t2)};
      }
      const Complex t2 = upper * conjugate(upper_0), t23 = upper * bend * conjugate(fore_0);
      const int second = kSecond + 2 * s + e;
      x[second] = t2.re;
      y[second] = t2.im;
      Mat3 R;
      R.row(0) = t23.re * n0 + t23.im * n2;
      R.row(1) = n1;
      R.row(2) = t23.re * n2 - t23.im * n0;
      if (!right_angled_) {
        const six::Turns turns(lead_.col(0), lead_.col(1), lead_.col(2));
        const auto found = turns.solve(R, reference != nullptr ? reference[3] : 0.0);
        oriented[s][e] = found.has_value();
        if (found) oblique[s][e] = *found;
        in_line[s][e] = found && found->in_line;
        for (int k = 0; k < 3; ++k) x[kWrist + 3 * (2 * s + e) + k] = y[kWrist + 3 * (2 * s + e) + k] = 0;
        continue;
      }
      // M = Rz(t4) Ry(t5) Rz(t6): its last column gives t4 and t5, the second row of Rz(-t4) M gives t6.
      const Vec3 m0 = lead_.transpose() * R.col(2);
      const double s5 = std::sqrt(square(m0.x()) + square(m0.y()));
      in_line[s][e] = s5 < kFree;
      Complex t4{1, 0};
      if (!in_line[s][e]) {
        const double over_s5 = 1 / s5;
        t4 = {m0.x() * over_s5, m0.y() * over_s5};
      } else if (reference != nullptr) {
        t4 = {std::cos(reference[3]), std::sin(reference[3])};
      }
      const Vec3 across = t4.re * lead_.col(1) - t4.im * lead_.col(0);  // second row of Rz(-t4) lead^T
      const int at = kWrist + 3 * (2 * s + e);
      x[at] = t4.re;
      y[at] = t4.im;
      x[at + 1] = m0.z();
      y[at + 1] = t4.re * m0.x() + t4.im * m0.y();
      x[at + 2] = across.dot(R.col(1));
      y[at + 2] = across.dot(R.col(0));
    }
  }
  angles_of(y, x, angle);
  for (int s = 0; s < 2; ++s) {
    if (!reached[s]) continue;
    const double q1 = six::in_range(sense_[0] * angle[kFirst + s], range_[0], reference, 0);
    for (int e = 0; e < 2; ++e) {
      const double q2 = six::in_range(sense_[1] * angle[kSecond + 2 * s + e], range_[1], reference, 1);
      const double g = s == e ? -angle[kBend + s] : angle[kBend + s];
      const double q3 = six::in_range(sense_[2] * (g - bend_), range_[2], reference, 2);
      for (int f = 0; f < 2; ++f) {
        const int k = 4 * e + 2 * s + (swapped_ ? 1 - f : f);
        double t4 = 0, t5 = 0, t6 = 0;
        if (right_angled_) {
          const double* t = angle + kWrist + 3 * (2 * s + e);
          const double half = f == 0 || (in_line[s][e] && reference != nullptr) ? 0.0 : kPi;
          t4 = t[0] + half;
          t5 = middle_ + (f == 0 ? t[1] : -t[1]);
          t6 = t[2] + half;
        } else {
          t4 = oblique[s][e].q4[f];
          t5 = oblique[s][e].q5[f];
          t6 = oblique[s][e].q6[f];
        }
        double* q = out.joints[k];
        out.exists[k] = right_angled_ || oriented[s][e];
        if (!out.exists[k]) continue;
        q[0] = q1;
        q[1] = q2;
        q[2] = q3;
        q[3] = six::in_range(t4, range_[3], reference, 3);
        q[4] = six::in_range(t5, range_[4], reference, 4);
        q[5] = six::in_range(t6, range_[5], reference, 5);
        out.singular[k] = over_axis || beside || folded[s] || met[s] || in_line[s][e];
      }
    }
  }
}

std::optional<SphericalWristInverse::Form> SphericalWristInverse::form() const {
  if (!right_angled_) return std::nullopt;
  return Form{range_,
              sense_,
              R_AM_,
              p_AM_,
              wrist_T_,
              tool_,
              lead_,
              a1_,
              b_,
              upper_,
              fore_,
              {upper_c_, upper_s_},
              {fore_c_, fore_s_},
              bend_,
              middle_};
}

kinematics::LimitBits SphericalWristInverse::violations(const double* joints) const {
  return six::violations(range_, joints);
}

kinematics::InverseResult SphericalWristInverse::solve(const Pose& X_MT, const double* reference) const {
  Branches branches;
  solve(X_MT, branches, reference);
  const Vec3 c = R_AM_ * (X_MT * wrist_T_) + p_AM_;
  const bool beside = square(c.x()) + square(c.y()) < b_ * b_;
  return six::result(branches, range_,
                     beside ? "the wrist centre is nearer to axis 1 than its offset from the arm's plane"
                     : right_angled_
                         ? "the wrist centre is out of reach of the two links"
                         : "the wrist centre is out of reach of the two links, or the wrist cannot turn so far");
}

}  // namespace polypod::machine
