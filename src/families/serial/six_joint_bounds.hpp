// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The joint limits of a six-joint arm with a right-angled spherical wrist, over boxes of tool positions and patches of
// orientations.
#pragma once

#include <algorithm>
#include <vector>

#include "limit_terms.hpp"
#include "polypod/families/serial/spherical_wrist.hpp"

namespace polypod::workspace {

/// Follows SphericalWristInverse::solve in first order. A direction counts where some of the 8 branches keeps all
/// limits; a cell is decided where the same branch does so for a whole patch.
///
/// Angles never appear: a limit of joints 1, 2, 4 and 6 is a half plane of a vector that has the joint's direction, of
/// joints 3 and 5, which go through half a turn in each branch, a bound of the cosine. These are smooth where the arm
/// is stretched (joint 3) and the wrist straight (joint 5); the others have roots there, and cells next to those poses
/// stay open until they are small.
class SixJointLimits {
 public:
  using Form = machine::SphericalWristInverse::Form;
  using Vector = std::array<FirstOrder, 3>;
  /// Over a patch, in the arm's frame A: the columns of R_AM R tool, and the way from the tip to the wrist centre.
  struct Data {
    std::array<Vector, 3> column;
    Vector to_wrist;
  };

  /// `coupling`: by which joint 2 turns joint 3, too, 1 or -1 (as both count), the ranges being those of the drives; 0:
  /// not coupled.
  SixJointLimits(const Form& form, LimitBits mask, int coupling = 0) : f_(form), mask_(mask), coupling_(coupling) {
    for (std::size_t i = 0; i < 6; ++i) turn_[i] = arm::Turn(f_.range[i].min, f_.range[i].max, free_turn(i));
    for (std::size_t side = 0; side < 2; ++side) {
      const double sign = side == 0 ? 1 : -1;
      // Coupled, its range is one of an angle that joint 2 changes.
      elbow_[side] =
          arm::half_turn_of(f_.range[2], free_turn(2) || coupling_ != 0, -f_.sense[2] * f_.bend, sign * f_.sense[2]);
      wrist_[side] = arm::half_turn_of(f_.range[4], free_turn(4), f_.middle, sign);
    }
  }

  [[nodiscard]] static int groups() { return 1; }
  /// Where elbows or wrists meet, bounds of the other limits converge with the first order of the box only.
  /// What takes ten seconds of one direction, at 8 us each.
  [[nodiscard]] static std::int64_t few_boxes() { return 1'200'000; }
  /// Of a cone the gap falls with the first order of the box: ten times as many do not halve it.
  [[nodiscard]] static std::int64_t few_boxes_of_a_cone() { return 10'000; }
  /// As ArmLimits.
  [[nodiscard]] double lever() const {
    const auto possible = [](const std::array<arm::HalfTurn, 2>& sides) {
      return std::count_if(sides.begin(), sides.end(),
                           [](const arm::HalfTurn& h) { return h.verdict != Verdict::dead; });
    };
    return (possible(elbow_) * possible(wrist_) > 1 ? 0.5 : 2.0) * (f_.wrist_T.norm() + f_.fore);
  }
  /// From the tip to what its turns leave in place, m.
  [[nodiscard]] double hand() const { return f_.wrist_T.norm(); }
  [[nodiscard]] static LimitBits ends() { return 0; }  // its links are rigid
  void box(Vec3& low, Vec3& high, const Directions&) const {
    const Vec3 center = -(f_.R_AM.transpose() * f_.p_AM);
    const double reach = std::abs(f_.a1) + std::abs(f_.b) + f_.upper + f_.fore + f_.wrist_T.norm();
    low = center - Vec3::Constant(reach);
    high = center + Vec3::Constant(reach);
  }

  [[nodiscard]] static std::size_t bytes(const Data&) { return 0; }
  [[nodiscard]] Data prepare(const Patch& patch) const {
    const auto turned = [&](const Vec3& b_T) { return arm::turned(f_.R_AM, patch, b_T); };
    return {{turned(f_.tool.col(0)), turned(f_.tool.col(1)), turned(f_.tool.col(2))}, turned(f_.wrist_T)};
  }

  Verdict judge(int, const Vec3& center, const Vec3& half, double, const Patch& patch, const Data& data,
                BoundList& out) const {
    const Domain d{half, &patch};
    const Vector c = arm::moved(data.to_wrist, f_.R_AM, f_.p_AM, center);  // the wrist centre in A
    // What the branches of an elbow or a shoulder have in common is judged once: of conditions that stand in one branch
    // alone there are no bounds from above.
    const Column column(f_, c, d);
    Terms any;
    any.verdict = Verdict::dead;
    std::array<Verdict, 2> but_for_first{Verdict::dead, Verdict::dead};
    for (std::size_t s = 0; s < 2; ++s) {
      const Shoulder shoulder(f_, c, column, s == 0 ? 1.0 : -1.0, d);
      Terms all = shoulder.reach;
      if (all.verdict == Verdict::dead) continue;
      const Terms elbows = any_elbow(data, shoulder, d);
      all.append(elbows);
      but_for_first[s] = all.verdict;
      if (all.verdict != Verdict::dead) arm::keep_turn(turn_[0], 0, shoulder.t1_x, f_.sense[0] * shoulder.t1_y, d, all);
      arm::or_else(all, any);
      if (any.verdict == Verdict::inside) break;
    }
    // Of t1 and t1 + 180 deg a range of half a turn holds one.
    const bool half_a_turn = f_.b == 0 && f_.range[0].max - f_.range[0].min >= arm::kHalfTurn - 1e-12;
    if (half_a_turn && but_for_first[0] == Verdict::inside && but_for_first[1] == Verdict::inside)
      any.verdict = Verdict::inside;
    if (any.verdict == Verdict::undecided) out.append(any.bounds);
    return any.verdict;
  }

 private:
  using Terms = arm::Terms;
  static constexpr int kReach = 12, kBesideAxis = 14;  // beyond the labels of the joints' limits

  [[nodiscard]] bool free_turn(std::size_t joint) const {
    return arm::turns_freely(f_.range[joint].min, f_.range[joint].max, mask_, joint);
  }

  /// The wrist centre seen from axis 1.
  struct Column {
    FirstOrder r2, over_r2, rho, over_r;
    Column(const Form& f, const Vector& c, const Domain& d) {
      r2 = square(c[0], d) + square(c[1], d);
      rho = root(r2 - f.b * f.b, d);
      if (f.b == 0) {
        over_r = inverse_of_positive(rho, d);
      } else {
        over_r2 = inverse_of_positive(r2, d);
      }
    }
  };

  /// The direction of joint 1, and the way P from axis 2 to the wrist centre in the plane that it turns.
  struct Shoulder {
    Terms reach;            ///< of the two links, and past axis 1
    FirstOrder t1_x, t1_y;  ///< of any length
    FirstOrder cos1, sin1;
    FirstOrder P_x, P_z, distance2, cosine;  ///< the law of cosines: of the angle between the links
    Shoulder(const Form& f, const Vector& c, const Column& column, double side, const Domain& d) {
      if (f.b == 0) {
        t1_x = side * c[0];
        t1_y = side * c[1];
        cos1 = arm::at_most(times(t1_x, column.over_r, d), 1, d);
        sin1 = arm::at_most(times(t1_y, column.over_r, d), 1, d);
      } else {
        arm::add(column.r2 - f.b * f.b, kBesideAxis, d, reach);
        t1_x = side * times(c[0], column.rho, d) + f.b * c[1];
        t1_y = side * times(c[1], column.rho, d) - f.b * c[0];
        cos1 = arm::at_most(times(t1_x, column.over_r2, d), 1, d);
        sin1 = arm::at_most(times(t1_y, column.over_r2, d), 1, d);
      }
      P_x = side * column.rho - f.a1;
      P_z = c[2];
      distance2 = column.r2 - 2 * side * f.a1 * column.rho + square(P_z, d) + (f.a1 * f.a1 - f.b * f.b);
      cosine = (0.5 / (f.upper * f.fore)) * (distance2 - (f.upper * f.upper + f.fore * f.fore));
      arm::add(cosine + 1.0, kReach, d, reach);
      arm::add(FirstOrder(1) - cosine, kReach + 1, d, reach);
    }
  };

  /// One of the two positions of the links: the direction of joint 2, and that of joints 2 and 3 together.
  struct Elbow {
    FirstOrder t2_x, t2_y;  ///< of the length |P|^2
    FirstOrder cos23, sin23;
    FirstOrder sine;  ///< of the angle between the links
    Elbow(const Form& f, const Shoulder& shoulder, double sign, const Domain& d)
        : sine(sign * root(FirstOrder(1) - square(shoulder.cosine, d), d)) {
      // P = (upper + fore e^ig) e^it: e^it = P conj(upper + fore e^ig) / |P|^2.
      const FirstOrder E_x = f.fore * shoulder.cosine + f.upper, E_z = f.fore * sine;
      const FirstOrder u_x = times(shoulder.P_x, E_x, d) + times(shoulder.P_z, E_z, d),
                       u_z = times(shoulder.P_z, E_x, d) - times(shoulder.P_x, E_z, d);
      t2_x = f.upper_0[0] * u_x + f.upper_0[1] * u_z;
      t2_y = f.upper_0[0] * u_z - f.upper_0[1] * u_x;
      const FirstOrder over = inverse_of_positive(shoulder.distance2, d);
      const auto unit = [&](const FirstOrder& x) { return arm::at_most(times(x, over, d), 1, d); };
      const auto of_forearm = [&](const FirstOrder& P, const FirstOrder& u) {
        return arm::at_most((1 / f.fore) * (P - f.upper * unit(u)), 1, d);
      };
      const FirstOrder fore_x = of_forearm(shoulder.P_x, u_x), fore_z = of_forearm(shoulder.P_z, u_z);
      cos23 = f.fore_0[0] * fore_x + f.fore_0[1] * fore_z;
      sin23 = f.fore_0[0] * fore_z - f.fore_0[1] * fore_x;
    }
  };

  /// The turn that the wrist makes: the cosine of joint 5 from its straight position, and the directions of joints 4
  /// and 6, both of the length of its sine.
  struct Wrist {
    FirstOrder cosine, t4_x, t4_y, t6_x, t6_y;
    Wrist(const Form& f, const Data& data, const Shoulder& shoulder, const Elbow& elbow, bool sixth, const Domain& d) {
      const auto seen = [&](const Vector& n) {  // turned back by joints 1 to 3
        const FirstOrder out = arm::at_most(times(shoulder.cos1, n[0], d) + times(shoulder.sin1, n[1], d), 1, d);
        const FirstOrder across = arm::at_most(times(shoulder.cos1, n[1], d) - times(shoulder.sin1, n[0], d), 1, d);
        return Vector{arm::at_most(times(elbow.cos23, out, d) + times(elbow.sin23, n[2], d), 1, d), across,
                      arm::at_most(times(elbow.cos23, n[2], d) - times(elbow.sin23, out, d), 1, d)};
      };
      const auto along = [&](const Vector& r, Eigen::Index k) {
        return arm::at_most(f.lead(0, k) * r[0] + f.lead(1, k) * r[1] + f.lead(2, k) * r[2], 1, d);
      };
      const Vector last = seen(data.column[2]);
      t4_x = along(last, 0);
      t4_y = along(last, 1);
      cosine = along(last, 2);
      if (!sixth) return;
      const auto beside = [&](const Vector& r) {
        return arm::at_most(times(t4_x, along(r, 1), d) - times(t4_y, along(r, 0), d), 1, d);
      };
      t6_x = beside(seen(data.column[1]));
      t6_y = beside(seen(data.column[0]));
    }
  };

  /// The limits of joints 2 to 6 of one shoulder: some elbow, and some wrist of it, keeps them.
  [[nodiscard]] Terms any_elbow(const Data& data, const Shoulder& shoulder, const Domain& d) const {
    Terms any;
    any.verdict = Verdict::dead;
    for (std::size_t e = 0; e < 2 && any.verdict != Verdict::inside; ++e) {
      Terms all;
      arm::keep_within(elbow_[e], 4, shoulder.cosine, d, all);
      if (all.verdict == Verdict::dead) continue;
      const Elbow elbow(f_, shoulder, e == 0 ? 1.0 : -1.0, d);
      arm::keep_turn(turn_[1], 2, elbow.t2_x, f_.sense[1] * elbow.t2_y, d, all);
      if (all.verdict != Verdict::dead && coupling_ != 0) keep_coupled(shoulder, elbow, d, all);
      if (all.verdict == Verdict::dead) continue;
      const Wrist wrist(f_, data, shoulder, elbow, !turn_[5].free, d);
      all.append(any_wrist(wrist, d));
      arm::or_else(all, any);
    }
    return any;
  }
  /// Joint 3 less (1) or with (-1) joint 2: the product of the vectors that have their angles.
  void keep_coupled(const Shoulder& shoulder, const Elbow& elbow, const Domain& d, Terms& terms) const {
    const double cos = std::cos(f_.bend), sin = std::sin(f_.bend);
    const FirstOrder& c = shoulder.cosine;
    const FirstOrder x = cos * c + sin * elbow.sine, y = f_.sense[2] * (cos * elbow.sine - sin * c);
    const FirstOrder& x_2 = elbow.t2_x;
    const FirstOrder y_2 = -coupling_ * f_.sense[1] * elbow.t2_y;
    arm::keep_turn(turn_[2], 4, times(x, x_2, d) - times(y, y_2, d), times(x, y_2, d) + times(y, x_2, d), d, terms);
  }
  [[nodiscard]] Terms any_wrist(const Wrist& wrist, const Domain& d) const {
    Terms any;
    any.verdict = Verdict::dead;
    for (std::size_t k = 0; k < 2 && any.verdict != Verdict::inside; ++k) {
      const double flip = k == 0 ? 1 : -1;
      Terms all;
      arm::keep_within(wrist_[k], 8, wrist.cosine, d, all);
      if (all.verdict != Verdict::dead) arm::keep_turn(turn_[3], 6, flip * wrist.t4_x, flip * wrist.t4_y, d, all);
      if (all.verdict != Verdict::dead) arm::keep_turn(turn_[5], 10, flip * wrist.t6_x, flip * wrist.t6_y, d, all);
      arm::or_else(all, any);
    }
    return any;
  }

  Form f_;
  LimitBits mask_;
  int coupling_;
  std::array<arm::Turn, 6> turn_{};
  std::array<arm::HalfTurn, 2> elbow_, wrist_;
};

}  // namespace polypod::workspace
