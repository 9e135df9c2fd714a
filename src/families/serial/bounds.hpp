// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The joint limits of a serial arm with the closed wrist inverse, over boxes of tool positions and patches of tool
// axes.
#pragma once

#include "../../workspace/first_order.hpp"
#include "../../workspace/linear.hpp"
#include "../../workspace/no_bounds.hpp"
#include "polypod/families/serial/kinematics.hpp"

namespace polypod::workspace {

/// Follows WristInverse::solve (SLAV (2.18) to (2.34)) in first order. A direction counts where some of the 8 branches
/// keeps all limits; a cell is decided where the same branch does so for a whole patch.
class ArmLimits {
 public:
  /// The tool axis over a patch.
  struct Data {
    std::array<FirstOrder, 3> axis;
  };

  ArmLimits(const machine::WristInverse::Form& form, LimitBits mask) : f_(form), mask_(mask) {
    for (std::size_t i = 0; i < 5; ++i) {
      const auto [low, high] = range(i);
      turn_[i] = {free_turn(i), high - low <= kHalfTurn, std::cos(low), std::sin(low), std::cos(high), std::sin(high)};
    }
    for (const bool right : {true, false}) {
      elbow_[right ? 0 : 1] = half_circle_of(2, 0, right, true);
      wrist_[right ? 0 : 1] = half_circle_of(4, f_.axis_angle, right, false);
    }
  }

  [[nodiscard]] static int groups() { return 1; }
  /// Half the way from the tip to joint 2's end of the forearm: measured to be faster than the whole.
  [[nodiscard]] double lever() const { return 0.5 * (f_.reach + std::abs(f_.d4)); }

  void box(Vec3& low, Vec3& high, const Directions&) const {
    const Vec3 center = f_.X_BM.inverse() * Vec3(0, 0, f_.d1);
    const double reach = std::abs(f_.a1) + f_.a2 + std::abs(f_.d4) + f_.reach;
    low = center - Vec3::Constant(reach);
    high = center + Vec3::Constant(reach);
  }

  [[nodiscard]] static std::size_t bytes(const Data&) { return 0; }
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
    const FirstOrder r2 = square(c[0], d) + square(c[1], d);
    const FirstOrder r = root(r2, d);
    const FirstOrder height = c[2] - f_.d1;
    // Parts of the axis along and across the way out from joint 1: no more than its horizontal part, also where the
    // wrist centre stands above joint 1 and that way is any.
    const FirstOrder over_r = inverse_of_positive(r, d), level2 = square(k[0], d) + square(k[1], d);
    const double level = std::sqrt(std::max(0.0, level2.value + level2.radius(d)));
    const FirstOrder k_out_front = at_most(times(times(c[0], k[0], d) + times(c[1], k[1], d), over_r, d), level, d);
    const FirstOrder k_across_front = at_most(times(times(c[1], k[0], d) - times(c[0], k[1], d), over_r, d), level, d);

    Verdict result = Verdict::dead;
    BoundList of_branch;
    std::array<Verdict, 2> but_for_first{Verdict::dead, Verdict::dead};
    for (std::size_t shoulder = 0; shoulder < 2; ++shoulder) {
      const double side = shoulder == 0 ? 1.0 : -1.0;
      Terms first;
      turn(0, side * c[0], side * c[1], d, first);
      if (first.verdict == Verdict::dead) continue;
      const FirstOrder rho = side * r - f_.a1;
      // The squared distance of the wrist centre from joint 2, (2.20).
      const FirstOrder distance2 = r2 - 2 * side * f_.a1 * r + square(height, d) + f_.a1 * f_.a1;
      const FirstOrder s3 = (0.5 / (f_.a2 * f_.d4)) * (distance2 - (f_.a2 * f_.a2 + f_.d4 * f_.d4));
      const FirstOrder c3_up = root(FirstOrder(1) - square(s3, d), d);
      for (std::size_t elbow = 0; elbow < 2; ++elbow) {
        Terms upper;
        keep_within(elbow_[elbow], 2, s3, d, upper);
        if (upper.verdict == Verdict::dead) continue;
        // Seen from the upper arm the wrist centre lies at (x, -y), so that t2 = angle(rho, height) + angle(x, y); the
        // vector below has the direction of t2 and the length distance2.
        const FirstOrder x = FirstOrder(f_.a2) + f_.d4 * s3, y = (elbow == 0 ? f_.d4 : -f_.d4) * c3_up;
        const FirstOrder along = times(rho, x, d) - times(height, y, d);
        const FirstOrder up = times(height, x, d) + times(rho, y, d);
        turn(1, along, up, d, upper);
        if (upper.verdict == Verdict::dead) continue;
        // The forearm's direction is (wrist centre - elbow) / d4; k . forearm = -sin t5 (2.25).
        const FirstOrder k_out = side * k_out_front;
        const FirstOrder over = inverse_of_positive(distance2, d);
        const FirstOrder c2 = times(along, over, d), s2 = times(up, over, d);
        const FirstOrder s23 = (1 / f_.d4) * (rho - f_.a2 * c2), c23 = (1 / f_.d4) * (f_.a2 * s2 - height);
        const FirstOrder k3z = times(s23, k_out, d) - times(c23, k[2], d);
        const auto square_to_forearm = [&] {
          return std::array{times(c23, k_out, d) + times(s23, k[2], d), side * k_across_front};
        };
        for (std::size_t wrist = 0; wrist < 2; ++wrist) {
          if (wrist_[wrist].verdict == Verdict::dead) continue;
          Terms all = upper;
          keep_axis(wrist_[wrist], (-1.0) * k3z, square_to_forearm, d, all);
          if (all.verdict != Verdict::dead && !turn_[3].free) {
            const double flip = wrist == 0 ? 1.0 : -1.0;
            const auto [k3x, k3y] = square_to_forearm();
            turn(3, flip * k3x, flip * k3y, d, all);
          }
          if (all.verdict == Verdict::dead) continue;
          if (all.verdict == Verdict::inside) but_for_first[shoulder] = Verdict::inside;
          all.verdict = both(first.verdict, all.verdict);
          all.bounds.append(first.bounds);
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
    // Of t1 and t1 + 180 deg a range of half a turn holds one.
    if (f_.max[0] - f_.min[0] >= kHalfTurn - 1e-12 && but_for_first[0] == Verdict::inside &&
        but_for_first[1] == Verdict::inside) {
      out.clear();
      return Verdict::inside;
    }
    if (result == Verdict::undecided) out.append(of_branch);
    return result;
  }

 private:
  struct Terms {
    Verdict verdict = Verdict::inside;
    BoundList bounds;
  };
  static constexpr double kHalfTurn = std::numbers::pi;
  static constexpr double kTurn = 2 * std::numbers::pi;

  /// Any angle is some turn within the range, or one of its ends may be passed.
  [[nodiscard]] bool free_turn(std::size_t joint) const {
    return f_.max[joint] - f_.min[joint] >= kTurn - 1e-9 || (mask_ >> (2 * joint) & 3U) != 3;
  }
  /// The range of joint i as angles of the Denavit-Hartenberg table, rising.
  [[nodiscard]] std::array<double, 2> range(std::size_t i) const {
    const double at_min = f_.offset[i] + f_.sign[i] * f_.min[i], at_max = f_.offset[i] + f_.sign[i] * f_.max[i];
    return {std::min(at_min, at_max), std::max(at_min, at_max)};
  }

  static constexpr double kScale = 10;  // no term of a limit is larger, in m, m^2 or as a sine
  /// f, of which it is known that |f| <= most.
  static FirstOrder at_most(const FirstOrder& f, double most, const Domain& d) {
    if (f.radius(d) <= most) return f;
    FirstOrder out;
    out.rest = most;
    return out;
  }
  static Linear linear_of(const FirstOrder& f) {
    return {f.value, Vec3(f.gradient[0], f.gradient[1], f.gradient[2]), f.gradient[3], f.gradient[4], f.rest, f.rest};
  }
  static Verdict judged(const FirstOrder& f, int limit, const Domain& d, BoundList& bounds) {
    if (!std::isfinite(f.radius(d))) return Verdict::open;
    return weigh(linear_of(f), limit, kScale, d.half, *d.patch, bounds);
  }
  static void add(const FirstOrder& f, int limit, const Domain& d, Terms& terms) {
    terms.verdict = both(terms.verdict, judged(f, limit, d, terms.bounds));
  }

  /// The angle of the vector (x, y) within the range of joint i. A range of up to half a turn is the common part of two
  /// half planes, a longer one their union.
  struct Turn {
    bool free, common;
    double cos_low, sin_low, cos_high, sin_high;
  };
  void turn(std::size_t i, const FirstOrder& x, const FirstOrder& y, const Domain& d, Terms& terms) const {
    const Turn& range = turn_[i];
    if (range.free) return;
    const int limit = static_cast<int>(2 * i);
    const FirstOrder from_low = range.cos_low * y - range.sin_low * x,
                     to_high = range.sin_high * x - range.cos_high * y;
    if (range.common) {
      add(from_low, limit, d, terms);
      add(to_high, limit + 1, d, terms);
      return;
    }
    BoundList above, below;
    const Verdict keeps_low = judged(from_low, limit, d, above), keeps_high = judged(to_high, limit + 1, d, below);
    if (keeps_low == Verdict::inside || keeps_high == Verdict::inside) return;
    if (keeps_low == Verdict::dead) {
      terms.verdict = both(terms.verdict, keeps_high);
      terms.bounds.append(below);
    } else if (keeps_high == Verdict::dead) {
      terms.verdict = both(terms.verdict, keeps_low);
      terms.bounds.append(above);
    } else {
      terms.verdict = both(terms.verdict, Verdict::open);
    }
  }

  /// The angles t in the right half circle (-90 to 90 deg) or the left one (90 to 270) with t - shift in the range of
  /// joint i, as a range of their sines. In a half circle t is a monotone function of its sine, which stays smooth
  /// where the arm is stretched and where the tool axis meets the forearm.
  struct HalfCircle {
    Verdict verdict = Verdict::undecided;  ///< dead: none; open: the range meets the half circle at both its ends
    bool from = false, to = false;         ///< whether there is something to keep
    double sine_from = -1, sine_to = 1;
  };
  /// `reach`: |sine| <= 1 is a condition, not a fact.
  [[nodiscard]] HalfCircle half_circle_of(std::size_t i, double shift, bool right, bool reach) const {
    HalfCircle out;
    double from = -kHalfTurn / 2, to = kHalfTurn / 2;
    if (!free_turn(i)) {
      const auto [low, high] = range(i);
      const double half_width = 0.5 * (high - low);
      double middle = 0.5 * (low + high) + shift;
      if (!right) middle = kHalfTurn - middle;  // the mirrored angle runs over the mirrored range
      middle = std::remainder(middle, kTurn);
      if (middle + half_width - kTurn > from || middle - half_width + kTurn < to) {
        out.verdict = Verdict::open;
        return out;
      }
      if (middle + half_width < from || middle - half_width > to) {
        out.verdict = Verdict::dead;
        return out;
      }
      from = std::max(from, middle - half_width);
      to = std::min(to, middle + half_width);
    }
    out.from = reach || from > -kHalfTurn / 2;
    out.to = reach || to < kHalfTurn / 2;
    out.sine_from = std::sin(from);
    out.sine_to = std::sin(to);
    return out;
  }
  static void keep_within(const HalfCircle& range, std::size_t i, const FirstOrder& sine, const Domain& d,
                          Terms& terms) {
    if (range.verdict != Verdict::undecided) {
      terms.verdict = both(terms.verdict, range.verdict);
      return;
    }
    const int limit = static_cast<int>(2 * i);
    if (range.from) add(sine - range.sine_from, limit, d, terms);
    if (range.to) add(FirstOrder(range.sine_to) - sine, limit + 1, d, terms);
  }

  /// The limits of joint 5. Near 90 deg the sine is flat and says little, and what is forbidden is a thin cone of tool
  /// axes round the forearm: there the limit is that of |v| = cos t5, v = (k3x, k3y) the part of the axis square to it.
  template <class SquareToForearm>
  void keep_axis(const HalfCircle& range, const FirstOrder& sine, const SquareToForearm& square_to_forearm,
                 const Domain& d, Terms& terms) const {
    constexpr double kFlat = 0.9;
    const double radius = sine.radius(d);
    const bool at_low = range.from && range.sine_from < -kFlat && sine.value + radius < -0.5;
    const bool at_high = range.to && range.sine_to > kFlat && sine.value - radius > 0.5;
    if (range.verdict != Verdict::undecided || (!at_low && !at_high)) return keep_within(range, 4, sine, d, terms);
    const int limit = at_low ? 8 : 9;
    const double edge = at_low ? range.sine_from : range.sine_to;
    if (at_low ? sine.value - radius >= edge + kRounding : sine.value + radius <= edge - kRounding) return;
    const double least = std::sqrt((1 - edge) * (1 + edge));
    const auto v = square_to_forearm();
    if (!std::isfinite(v[0].radius(d)) || !std::isfinite(v[1].radius(d))) return keep_within(range, 4, sine, d, terms);
    if (passes_through(v, least, d)) {
      terms.verdict = both(terms.verdict, Verdict::outside);
      return;
    }
    const double norm = std::hypot(v[0].value, v[1].value);
    const double c = norm > 0 ? v[0].value / norm : 1, s = norm > 0 ? v[1].value / norm : 0;
    const FirstOrder along = c * v[0] + s * v[1], aside = c * v[1] - s * v[0];
    // along <= |v| <= along + what the part aside adds.
    const double most = aside.radius(d), low = along.value - along.radius(d);
    Linear g = linear_of(along - least);
    g.above += low > 0.5 * most ? 0.5 * most * most / low : most + std::max(0.0, -2 * low);
    terms.verdict = both(terms.verdict, weigh(g, limit, kScale, d.half, *d.patch, terms.bounds));
  }

  /// True if every position of the cell has a direction in the patch for which |v| < least: the one that makes the
  /// linear part of v vanish, if it lies in the patch wherever in the cell the position is.
  static bool passes_through(const std::array<FirstOrder, 2>& v, double least, const Domain& d) {
    if (!(std::hypot(v[0].rest, v[1].rest) < least - kRounding)) return false;
    Eigen::Matrix2d J;
    J << v[0].gradient[3], v[0].gradient[4], v[1].gradient[3], v[1].gradient[4];
    if (!(std::abs(J.determinant()) > 1e-6 * J.squaredNorm())) return false;
    const Eigen::Matrix2d inverse = J.inverse();
    const Eigen::Vector2d middle = -inverse * Eigen::Vector2d(v[0].value, v[1].value);
    Eigen::Matrix<double, 2, 3> by_position;
    for (int k = 0; k < 3; ++k) {
      const auto at = static_cast<std::size_t>(k);
      by_position.col(k) = inverse * Eigen::Vector2d(v[0].gradient[at], v[1].gradient[at]);
    }
    const Eigen::Vector2d reach = by_position.cwiseAbs() * d.half;
    return d.patch->holds(middle, reach * (1 + kRounding));
  }

  machine::WristInverse::Form f_;
  LimitBits mask_;
  std::array<Turn, 5> turn_{};
  std::array<HalfCircle, 2> elbow_, wrist_;
};

/// What volume() asks over boxes. Errors: WS102 (the arm does not have the wrist of WristInverse).
inline Result<ArmLimits> bounds_of(const machine::SerialArm& arm, const Options& options) {
  const auto closed = machine::WristInverse::of(arm);
  if (!closed) return no_bounds(arm.name);
  return ArmLimits(closed->form(), options.limits);
}

}  // namespace polypod::workspace
