// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The joint limits of a serial arm with the closed wrist inverse, over boxes of tool positions and patches of tool axes.
#pragma once

#include "first_order.hpp"
#include "linear.hpp"
#include "polypod/kinematics/serial_arm.hpp"

namespace polypod::workspace {

/// Follows WristInverse::solve (SLAV (2.18) to (2.34)) in first order. A direction counts where some of the 8 branches
/// keeps all limits; a cell is decided where the same branch does so for a whole patch.
class ArmLimits {
 public:
  /// The tool axis over a patch.
  struct Data {
    std::array<FirstOrder, 3> axis;
  };

  ArmLimits(const machine::WristInverse::Form& form, LimitBits mask) : f_(form), mask_(mask) {}

  [[nodiscard]] static int groups() { return 1; }
  [[nodiscard]] double lever() const { return f_.reach + std::abs(f_.d4); }

  void box(Vec3& low, Vec3& high, const Directions&) const {
    const Vec3 center = f_.X_BM.inverse() * Vec3(0, 0, f_.d1);
    const double reach = std::abs(f_.a1) + f_.a2 + std::abs(f_.d4) + f_.reach;
    low = center - Vec3::Constant(reach);
    high = center + Vec3::Constant(reach);
  }

  /// k = R z in first order: the rest is bounded by the patch's bend.
  [[nodiscard]] Data prepare(const Patch& patch) const {
    Data data;
    const Vec3 k = f_.X_BM.R * patch.R.col(2);
    const Vec3 k1 = f_.X_BM.R * patch.omega1.cross(patch.R.col(2)), k2 = f_.X_BM.R * patch.omega2.cross(patch.R.col(2));
    for (std::size_t i = 0; i < 3; ++i) {
      const auto at = static_cast<Eigen::Index>(i);
      data.axis[i].value = k[at];
      data.axis[i].gradient = {0, 0, 0, k1[at], k2[at]};
      data.axis[i].rest = patch.bend;
    }
    return data;
  }

  Verdict judge(int, const Vec3& center, const Vec3& half, double, const Patch& patch, const Data& data,
                BoundList& out) const {
    const Domain d{half, &patch};
    const auto& k = data.axis;
    std::array<FirstOrder, 3> c;  // the wrist centre in the base
    const Vec3 p = f_.X_BM * center;
    for (std::size_t i = 0; i < 3; ++i) {
      const auto at = static_cast<Eigen::Index>(i);
      c[i].value = p[at];
      c[i].gradient = {f_.X_BM.R(at, 0), f_.X_BM.R(at, 1), f_.X_BM.R(at, 2), 0, 0};
      c[i] = c[i] + f_.reach * k[i];
    }
    const FirstOrder r = root(times(c[0], c[0], d) + times(c[1], c[1], d), d);
    const FirstOrder over_r = inverse_of_positive(r, d);
    const FirstOrder c1_front = times(c[0], over_r, d), s1_front = times(c[1], over_r, d);
    const FirstOrder t1_front = angle(c[1], c[0], d);
    const FirstOrder height = c[2] - f_.d1;

    Verdict result = Verdict::dead;
    BoundList of_branch;
    for (int shoulder = 0; shoulder < 2; ++shoulder) {
      const double side = shoulder == 0 ? 1.0 : -1.0;
      FirstOrder t1 = t1_front;
      if (shoulder == 1) t1.value += std::numbers::pi;
      Terms first{Verdict::inside, {}};
      joint(0, t1, d, first);
      if (first.verdict == Verdict::dead) continue;
      const FirstOrder c1 = side * c1_front, s1 = side * s1_front, rho = side * r - f_.a1;
      const FirstOrder s3 =
          (0.5 / (f_.a2 * f_.d4)) *
          (times(rho, rho, d) + times(height, height, d) - (f_.a2 * f_.a2 + f_.d4 * f_.d4));
      const FirstOrder c3_up = root(FirstOrder(1) - times(s3, s3, d), d);
      for (int elbow = 0; elbow < 2; ++elbow) {
        Terms upper = first;
        elbow_limits(s3, elbow == 0, d, upper);
        if (upper.verdict == Verdict::dead) continue;
        const FirstOrder c3 = (elbow == 0 ? 1.0 : -1.0) * c3_up;
        // t2 = angle to the wrist +- angle at the shoulder; the same without angles:
        // (rho, height) = turned by t2 of (-d4 c... ): with x = a2 + d4 s3, y = d4 c3: t2 = angle(rho, h) + angle(x, y).
        const FirstOrder x = FirstOrder(f_.a2) + f_.d4 * s3, y = f_.d4 * c3;
        const FirstOrder cosine_2 = times(rho, x, d) - times(height, y, d);
        const FirstOrder sine_2 = times(height, x, d) + times(rho, y, d);
        const FirstOrder t2 = angle(sine_2, cosine_2, d);
        joint(1, t2, d, upper);
        if (upper.verdict == Verdict::dead) continue;
        // Unit vector of t2 from the triangle, then of t2 + t3.
        const FirstOrder over = inverse_of_positive(times(rho, rho, d) + times(height, height, d), d);
        const FirstOrder c2 = times(cosine_2, over, d), s2 = times(sine_2, over, d);
        const FirstOrder c23 = times(c2, c3, d) - times(s2, s3, d), s23 = times(s2, c3, d) + times(c2, s3, d);
        const FirstOrder k_out = times(c1, k[0], d) + times(s1, k[1], d);
        const FirstOrder k3x = times(c23, k_out, d) + times(s23, k[2], d);
        const FirstOrder k3y = times(s1, k[0], d) - times(c1, k[1], d);
        const FirstOrder k3z = times(s23, k_out, d) - times(c23, k[2], d);
        const FirstOrder c5 = root(times(k3x, k3x, d) + times(k3y, k3y, d), d);
        for (int wrist = 0; wrist < 2; ++wrist) {
          const double flip = wrist == 0 ? 1.0 : -1.0;
          Terms all = upper;
          if (!free_turn(3)) joint(3, angle(flip * k3y, flip * k3x, d), d, all);
          FirstOrder t5 = angle((-1.0) * k3z, flip * c5, d);
          t5.value -= f_.axis_angle;
          joint(4, t5, d, all);
          if (all.verdict == Verdict::dead) continue;
          if (all.verdict == Verdict::inside) {
            out.clear();
            return Verdict::inside;
          }
          if (result == Verdict::dead) {  // the only possible branch so far
            result = all.verdict;
            of_branch = all.bounds;
          } else {
            result = Verdict::open;
          }
        }
      }
    }
    if (result == Verdict::undecided) out.append(of_branch);
    return result;
  }

 private:
  struct Terms {
    Verdict verdict = Verdict::inside;
    BoundList bounds;
  };

  [[nodiscard]] bool heeds(std::size_t joint, bool upper) const { return (mask_ >> (2 * joint + (upper ? 1U : 0U)) & 1U) != 0; }
  /// Any angle is some turn within the range.
  [[nodiscard]] bool free_turn(std::size_t joint) const {
    return f_.max[joint] - f_.min[joint] >= 2 * std::numbers::pi - 1e-9 || (!heeds(joint, false) && !heeds(joint, true));
  }

  static void add(const FirstOrder& f, int limit, const Domain& d, Terms& terms) {
    if (!std::isfinite(f.radius(d))) {
      terms.verdict = both(terms.verdict, Verdict::open);
      return;
    }
    Linear g;
    g.value = f.value;
    g.G = Vec3(f.gradient[0], f.gradient[1], f.gradient[2]);
    g.s1 = f.gradient[3];
    g.s2 = f.gradient[4];
    g.below = g.above = f.rest;
    terms.verdict = both(terms.verdict, weigh(g, limit, 10, d.half, *d.patch, terms.bounds));
  }

  /// q = sign (t - offset) in the turn that lies nearest the middle of its range. A domain over which q sweeps half of
  /// what is missing to a full turn could meet the range at its other end too: open then.
  void joint(std::size_t i, const FirstOrder& t, const Domain& d, Terms& terms) const {
    if (free_turn(i)) return;
    FirstOrder q = f_.sign[i] * (t - f_.offset[i]);
    const double middle = 0.5 * (f_.min[i] + f_.max[i]);
    const double gap = 2 * std::numbers::pi - (f_.max[i] - f_.min[i]);
    if (!(q.radius(d) < 0.5 * gap)) {
      terms.verdict = both(terms.verdict, Verdict::open);
      return;
    }
    q.value = middle + std::remainder(q.value - middle, 2 * std::numbers::pi);
    const int limit = static_cast<int>(2 * i);
    if (heeds(i, false)) add(q - f_.min[i], limit, d, terms);
    if (heeds(i, true)) add(FirstOrder(f_.max[i]) - q, limit + 1, d, terms);
  }

  /// Joint 3 by the sine of its angle, which stays smooth where the arm is stretched: on this side of the elbow the
  /// angle is a monotone function of s3, so its range is one of s3. Also the reach, |s3| <= 1.
  void elbow_limits(const FirstOrder& s3, bool up, const Domain& d, Terms& terms) const {
    // t3 = offset + sign q over the range of q; up: t3 in [-90, 90] deg, down: 180 deg - t3 is.
    double low = -1, high = 1;
    if (heeds(2, false) || heeds(2, true)) {
      const double at_min = f_.offset[2] + f_.sign[2] * f_.min[2], at_max = f_.offset[2] + f_.sign[2] * f_.max[2];
      const double half_turn = std::numbers::pi / 2;
      const double width = std::abs(at_max - at_min);
      double middle = 0.5 * (at_min + at_max);
      if (!up) middle = std::numbers::pi - middle;  // the mirrored angle runs over the mirrored range
      middle = std::remainder(middle, 2 * std::numbers::pi);
      if (width < 2 * std::numbers::pi) {
        double from = middle - 0.5 * width, to = middle + 0.5 * width;
        // The half circle meets the range once unless the range is longer than a half turn and wraps round.
        if (to - 2 * std::numbers::pi > -half_turn || from + 2 * std::numbers::pi < half_turn) {
          terms.verdict = both(terms.verdict, Verdict::open);
          return;
        }
        if (to < -half_turn || from > half_turn) {
          terms.verdict = Verdict::dead;
          return;
        }
        from = std::max(from, -half_turn);
        to = std::min(to, half_turn);
        low = std::sin(from);
        high = std::sin(to);
      }
    }
    add(s3 - low, 4, d, terms);
    add(FirstOrder(high) - s3, 5, d, terms);
  }

  machine::WristInverse::Form f_;
  LimitBits mask_;
};

}  // namespace polypod::workspace
