// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The reach of a six-joint arm with three parallel axes and a right-angled wrist, over boxes of tool positions and
// patches of orientations.
#pragma once

#include "limit_terms.hpp"
#include "polypod/families/serial/three_parallel.hpp"

namespace polypod::workspace {

/// Follows ThreeParallelInverse::solve in first order, for arms of which joint 3 alone may be limited: the other five
/// go through a whole turn, so that some turn of theirs is within the limits of any pose. What is left is that the two
/// links reach axis 4 with joint 3 in its range, for one of the two shoulders and the two wrists. Where axes 4 and 6
/// are in line, joints 2 to 4 are free to turn; cells next to that stay open until they are small.
class ThreeParallelLimits {
 public:
  using Form = machine::ThreeParallelInverse::Form;
  using Vector = std::array<FirstOrder, 3>;
  /// Over a patch, in the arm's frame A: the direction of axis 6, and the way from the tip to P.
  struct Data {
    Vector sixth, to_P;
  };

  /// Whether joint 3 alone is limited.
  [[nodiscard]] static bool serves(const Form& form, LimitBits mask) {
    for (std::size_t i = 0; i < 6; ++i)
      if (i != 2 && !free_turn(form, mask, i)) return false;
    return true;
  }
  ThreeParallelLimits(const Form& form, LimitBits mask) : f_(form) {
    for (std::size_t side = 0; side < 2; ++side) {
      const double sign = side == 0 ? 1 : -1;
      elbow_[side] = arm::half_turn_of(f_.range[2], free_turn(f_, mask, 2), -f_.sense_3 * f_.bend, sign * f_.sense_3);
    }
  }

  [[nodiscard]] static int groups() { return 1; }
  /// As of SixJointLimits, one of several branches; at 1 us each.
  [[nodiscard]] static std::int64_t few_boxes() { return 10'000'000; }
  [[nodiscard]] double lever() const { return 0.5 * (f_.P_T.norm() + std::hypot(f_.hand[0], f_.hand[1]) + f_.fore); }
  /// As of SixJointLimits.
  [[nodiscard]] double hand() const { return f_.P_T.norm() + std::hypot(f_.hand[0], f_.hand[1]); }
  [[nodiscard]] static LimitBits ends() { return 0; }  // its links are rigid
  void box(Vec3& low, Vec3& high, const Directions&) const {
    const Vec3 center = -(f_.R_AM.transpose() * f_.p_AM);
    const double reach =
        std::abs(f_.a1) + std::abs(f_.b) + f_.upper + f_.fore + std::hypot(f_.hand[0], f_.hand[1]) + f_.P_T.norm();
    low = center - Vec3::Constant(reach);
    high = center + Vec3::Constant(reach);
  }

  [[nodiscard]] static std::size_t bytes(const Data&) { return 0; }
  [[nodiscard]] Data prepare(const Patch& patch) const {
    return {arm::turned(f_.R_AM, patch, f_.w6_T), arm::turned(f_.R_AM, patch, f_.P_T)};
  }

  Verdict judge(int, const Vec3& center, const Vec3& half, double, const Patch& patch, const Data& data,
                BoundList& out) const {
    const Domain d{half, &patch};
    const Vector c = arm::moved(data.to_P, f_.R_AM, f_.p_AM, center);  // P in A
    // P beside axis 1, what all branches have in common.
    const FirstOrder r2 = square(c[0], d) + square(c[1], d), rho2 = r2 - f_.b * f_.b, rho = root(rho2, d);
    Terms common, any;
    if (f_.b != 0) arm::add(rho2, kBesideAxis, d, common);
    any.verdict = Verdict::dead;
    const FirstOrder over = inverse_of_positive(f_.b == 0 ? rho : r2, d);
    for (const double side : {1.0, -1.0}) {
      if (common.verdict == Verdict::dead || any.verdict == Verdict::inside) break;
      const Vector t1 =
          f_.b == 0 ? Vector{side * c[0], side * c[1], {}}
                    : Vector{side * times(c[0], rho, d) + f_.b * c[1], side * times(c[1], rho, d) - f_.b * c[0], {}};
      const FirstOrder cos1 = arm::at_most(times(t1[0], over, d), 1, d),
                       sin1 = arm::at_most(times(t1[1], over, d), 1, d);
      // Axis 6 turned back by joint 1: its part in the arm's plane has the direction of the hand.
      const FirstOrder x = arm::at_most(times(cos1, data.sixth[0], d) + times(sin1, data.sixth[1], d), 1, d);
      const FirstOrder y = arm::at_most(times(cos1, data.sixth[1], d) - times(sin1, data.sixth[0], d), 1, d);
      const FirstOrder over_part = inverse_of_positive(root(FirstOrder(1) - square(y, d), d), d);
      const FirstOrder u_x = arm::at_most(times(x, over_part, d), 1, d),
                       u_z = arm::at_most(times(data.sixth[2], over_part, d), 1, d);
      const FirstOrder hand_x = f_.hand[0] * u_x - f_.hand[1] * u_z, hand_z = f_.hand[1] * u_x + f_.hand[0] * u_z;
      // |P - hand|^2 from axis 2, the hand of a fixed length.
      const FirstOrder P_x = side * rho - f_.a1;
      const FirstOrder away2 = r2 - 2 * side * f_.a1 * rho + square(c[2], d) + (f_.a1 * f_.a1 - f_.b * f_.b);
      const FirstOrder along = times(P_x, hand_x, d) + times(c[2], hand_z, d);
      for (const double flip : {1.0, -1.0}) {
        const FirstOrder distance2 = away2 - 2 * flip * along + (f_.hand[0] * f_.hand[0] + f_.hand[1] * f_.hand[1]);
        const FirstOrder cosine =
            (0.5 / (f_.upper * f_.fore)) * (distance2 - (f_.upper * f_.upper + f_.fore * f_.fore));
        Terms all;
        arm::add(cosine + 1.0, kReach, d, all);
        arm::add(FirstOrder(1) - cosine, kReach + 1, d, all);
        if (all.verdict != Verdict::dead) all.append(any_elbow(cosine, d));
        arm::or_else(all, any);
        if (any.verdict == Verdict::inside) break;
      }
    }
    common.append(any);
    if (common.verdict == Verdict::undecided) out.append(common.bounds);
    return common.verdict;
  }

 private:
  using Terms = arm::Terms;
  static constexpr int kReach = 12, kBesideAxis = 14;  // beyond the labels of the joints' limits

  [[nodiscard]] static bool free_turn(const Form& f, LimitBits mask, std::size_t joint) {
    return arm::turns_freely(f.range[joint].min, f.range[joint].max, mask, joint);
  }
  [[nodiscard]] Terms any_elbow(const FirstOrder& cosine, const Domain& d) const {
    Terms any;
    any.verdict = Verdict::dead;
    for (const arm::HalfTurn& elbow : elbow_) {
      Terms all;
      arm::keep_within(elbow, 4, cosine, d, all);
      arm::or_else(all, any);
      if (any.verdict == Verdict::inside) break;
    }
    return any;
  }

  Form f_;
  std::array<arm::HalfTurn, 2> elbow_;
};

}  // namespace polypod::workspace
