// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/serial/three_parallel.hpp"

#include "six_joints.hpp"

namespace polypod::machine {

using six::Complex, six::conjugate, six::angle_of;
using six::kFree, six::kMeet, six::kSame, six::kStretched;

namespace {
/// The angle nearest to `angle` at which |to_P - hand e^(i angle)| lies between the reaches of both links, that is at
/// one of them where it does not there; `angle` itself where no angle helps.
double within_reach(const Complex& to_P, const Complex& hand, double upper, double fore, double angle) {
  const double far = std::hypot(to_P.re, to_P.im), h = std::hypot(hand.re, hand.im);
  const double between = angle_of(to_P) - angle_of(hand);  // where hand points to P
  const auto distance2 = [&](double at) { return far * far + h * h - 2 * far * h * std::cos(at - between); };
  const double now = std::sqrt(distance2(angle)), low = std::abs(upper - fore), high = upper + fore;
  if (now >= low && now <= high) return angle;
  const double wanted = now < low ? low : high;
  const double cosine = (far * far + h * h - wanted * wanted) / (2 * far * h);
  if (!(std::abs(cosine) <= 1)) return angle;
  const double side = std::remainder(angle - between, 2 * std::numbers::pi) < 0 ? -1 : 1;
  return between + side * std::acos(cosine);
}
}  // namespace

std::optional<ThreeParallelInverse> ThreeParallelInverse::of(const SerialArm& arm) {
  const std::optional<six::Axes> axes = six::axes_of(arm);
  if (!axes) return std::nullopt;
  const auto& [w, o, range, X_0] = *axes;
  if (w[1].cross(w[3]).norm() > kSame || w[3].cross(w[4]).norm() < kSame) return std::nullopt;
  const auto P = six::common_point(o[4], w[4], o[5], w[5]);
  if (!P) return std::nullopt;
  const auto links = six::links_of(arm, *axes, *P, o[3]);
  if (!links) return std::nullopt;
  ThreeParallelInverse out;
  out.range_ = range;
  out.R_AM_ = links->R_AM;
  out.p_AM_ = -(links->R_AM * links->origin);
  out.a1_ = links->a1;
  out.b_ = links->b;
  out.P_ = links->in_A(*P);
  out.fourth_ = links->in_A(o[3]);
  out.upper_ = links->upper;
  out.fore_ = links->fore;
  out.upper_c_ = links->upper_0.re;
  out.upper_s_ = links->upper_0.im;
  out.bend_ = links->bend;
  out.sense_ = {links->sense_1, links->sense(w[1]), links->sense(w[2]), links->sense(w[3])};
  out.R_TA_ = X_0.R.transpose() * out.R_AM_.transpose();
  out.P_T_ = X_0.R.transpose() * (*P - X_0.p);
  out.w5_ = out.R_AM_ * w[4];
  out.w6_ = out.R_AM_ * w[5];
  // Joint 4 counts against y or along it; both are straight where axes 4 and 6 are in line.
  out.swapped_ = std::numbers::pi - std::abs(six::Turns(Vec3::UnitY(), out.w5_, out.w6_).middle) < kSame;
  return out;
}

void ThreeParallelInverse::solve(const Pose& X_MT, Branches& out, const double* reference) const {
  for (int k = 0; k < Branches::kCount; ++k) out.exists[k] = out.singular[k] = false;
  const Mat3 R_AT = R_AM_ * X_MT.R;
  const Vec3 c = R_AM_ * X_MT.p + R_AT * P_T_ + p_AM_;
  const double size2 = square(upper_ + fore_ + std::abs(a1_)) + (P_ - fourth_).squaredNorm() + b_ * b_;
  const double r2 = square(c.x()) + square(c.y()), rho2 = r2 - b_ * b_;
  if (rho2 < -kStretched * size2) return;
  const double rho = std::sqrt(std::max(0.0, rho2));
  const bool over_axis = r2 < kFree * kFree, beside = rho2 < kStretched * size2;
  const six::Turns turns(Vec3::UnitY(), w5_, w6_);
  for (int s = 0; s < 2; ++s) {
    const double side = s == 0 ? rho : -rho;
    Complex t1{s == 0 ? 1.0 : -1.0, 0};
    if (!over_axis) {
      t1 = {(side * c.x() + b_ * c.y()) / r2, (side * c.y() - b_ * c.x()) / r2};
    } else if (reference != nullptr) {
      t1 = {std::cos(reference[0]), sense_[0] * std::sin(reference[0])};
    }
    Mat3 back;  // Rz(-t1)
    back << t1.re, t1.im, 0, -t1.im, t1.re, 0, 0, 0, 1;
    // The turn of the tool against joints 0, without joint 1: R_y(sum) R_5 R_6.
    const Mat3 R = back * R_AT * R_TA_;
    const double free6 = reference != nullptr ? reference[5] : 0.0;
    auto wrists = turns.solve(R, 0, &free6);
    if (!wrists) continue;
    const Complex to_P{side - a1_, c.z()}, hand{P_.x() - fourth_.x(), P_.z() - fourth_.z()};  // P from axis 2, from 4
    if (wrists->in_line) {
      // Joints 2 to 4 are free to turn together: as little as lets the links reach.
      const double angle = within_reach(to_P, hand, upper_, fore_, -wrists->q4[0]);
      if (angle != -wrists->q4[0]) wrists = turns.solve(R, -angle);
    }
    for (int f = 0; f < 2; ++f) {
      // From x to z against y: the sum of joints 2 to 4 in the arm's plane is -q4 of the three turns.
      const Complex sum{std::cos(wrists->q4[f]), -std::sin(wrists->q4[f])};
      const Complex off = sum * hand;
      const Complex D{to_P.re - off.re, to_P.im - off.im};  // axis 4 seen from axis 2
      const double D2 = square(D.re) + square(D.im);
      const double far = square(upper_ + fore_) - D2, near = D2 - square(upper_ - fore_);
      if (far < -kStretched * size2 || near < -kStretched * size2) continue;
      const double twice = 2 * upper_ * fore_;
      const double cg = std::clamp((D2 - upper_ * upper_ - fore_ * fore_) / twice, -1.0, 1.0);
      const double sg = std::sqrt(std::max(0.0, far) * std::max(0.0, near)) / twice;
      const bool folded = D2 < kFree * kFree;
      for (int e = 0; e < 2; ++e) {
        const Complex bend{cg, s == e ? -sg : sg};
        Complex t2{1, 0};
        if (!folded) {
          const Complex E{upper_ + fore_ * bend.re, fore_ * bend.im};
          t2 = D * conjugate(E * Complex{upper_c_, upper_s_});
        } else if (reference != nullptr) {
          t2 = {std::cos(reference[1]), sense_[1] * std::sin(reference[1])};
        }
        const double second = angle_of(t2), third = angle_of(bend) - bend_;
        const double fourth = std::remainder(-wrists->q4[f] - second - third, 2 * std::numbers::pi);
        const int k = 4 * e + 2 * s + (swapped_ ? 1 - f : f);
        double* q = out.joints[k];
        q[0] = six::in_range(sense_[0] * angle_of(t1), range_[0], reference, 0);
        q[1] = six::in_range(sense_[1] * second, range_[1], reference, 1);
        q[2] = six::in_range(sense_[2] * third, range_[2], reference, 2);
        q[3] = six::in_range(sense_[3] * fourth, range_[3], reference, 3);
        q[4] = six::in_range(wrists->q5[f], range_[4], reference, 4);
        q[5] = six::in_range(wrists->q6[f], range_[5], reference, 5);
        out.exists[k] = true;
        out.singular[k] = over_axis || beside || folded || sg < kMeet || wrists->in_line;
      }
    }
  }
}

std::optional<ThreeParallelInverse::Form> ThreeParallelInverse::form() const {
  if (std::abs(w5_.y()) > kSame || std::abs(w5_.dot(w6_)) > kSame) return std::nullopt;
  // Joint 5 turns axis 6 in the plane of y and this direction, joints 2 to 4 turn it in the arm's plane.
  const Vec3 lean = w5_.cross(Vec3::UnitY()).normalized();
  const Complex hand = Complex{P_.x() - fourth_.x(), P_.z() - fourth_.z()} * conjugate(Complex{lean.x(), lean.z()});
  return Form{range_, sense_[2], R_AM_, p_AM_, P_T_, R_TA_ * w6_, {hand.re, hand.im}, a1_, b_, upper_, fore_, bend_};
}

kinematics::LimitBits ThreeParallelInverse::violations(const double* joints) const {
  return six::violations(range_, joints);
}

kinematics::InverseResult ThreeParallelInverse::solve(const Pose& X_MT, const double* reference) const {
  Branches branches;
  solve(X_MT, branches, reference);
  return six::result(branches, range_, "the pose is out of reach of the two links");
}

}  // namespace polypod::machine
