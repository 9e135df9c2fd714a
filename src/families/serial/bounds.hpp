// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The joint limits of a serial arm with the closed wrist inverse, over boxes of tool positions and patches of tool
// axes.
#pragma once

#include <algorithm>
#include <tuple>
#include <variant>

#include "../../workspace/no_bounds.hpp"
#include "arm_plane.hpp"
#include "cartesian_bounds.hpp"
#include "limit_terms.hpp"
#include "one_more_bounds.hpp"
#include "polypod/families/serial/carried_arm.hpp"
#include "polypod/families/serial/kinematics.hpp"
#include "scara_bounds.hpp"
#include "six_joint_bounds.hpp"
#include "three_parallel_bounds.hpp"

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
      turn_[i] = arm::Turn(low, high, free_turn(i));
    }
    for (const bool right : {true, false}) {
      elbow_[right ? 0 : 1] = half_circle_of(2, 0, right, true);
      wrist_[right ? 0 : 1] = half_circle_of(4, f_.axis_angle, right, false);
    }
  }

  [[nodiscard]] static int groups() { return 1; }
  /// Twice the way from the tip to joint 2's end of the forearm: measured to be faster than once and four times; half
  /// of it where the joints' ranges leave several branches, each of which must be looked at (three times as fast).
  [[nodiscard]] double lever() const {
    const auto possible = [](const std::array<HalfCircle, 2>& sides) {
      return std::count_if(sides.begin(), sides.end(), [](const HalfCircle& h) { return h.verdict != Verdict::dead; });
    };
    return (possible(elbow_) * possible(wrist_) > 1 ? 0.5 : 2.0) * (f_.reach + std::abs(f_.d4));
  }

  /// As of SixJointLimits.
  [[nodiscard]] double hand() const { return f_.reach; }
  [[nodiscard]] static LimitBits ends() { return 0; }  // its links are rigid
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
    const ArmFrame frame(f_, c, k, d);

    Terms possible;
    possible.verdict = Verdict::dead;
    std::array<Verdict, 2> but_for_first{Verdict::dead, Verdict::dead};
    for (std::size_t shoulder = 0; shoulder < 2; ++shoulder) {
      const double side = shoulder == 0 ? 1.0 : -1.0;
      Terms first;
      turn(0, side * c[0], side * c[1], d, first);
      if (first.verdict == Verdict::dead) continue;
      const ArmPlane plane(f_, frame, side, d);
      for (std::size_t elbow = 0; elbow < 2; ++elbow) {
        Terms upper;
        keep_within(elbow_[elbow], 2, plane.s3, d, upper);
        if (upper.verdict == Verdict::dead) continue;
        const double bend = elbow == 0 ? 1.0 : -1.0;  // the sign of cos t3
        turn_upper_arm(plane, f_.d4 > 0 ? bend : -bend, d, upper);
        if (upper.verdict == Verdict::dead) continue;
        for (std::size_t wrist = 0; wrist < 2; ++wrist) {
          if (wrist_[wrist].verdict == Verdict::dead) continue;
          Terms all = upper;
          keep_axis(wrist_[wrist], plane, bend, d, all);
          if (all.verdict != Verdict::dead && !turn_[3].free) {
            const double flip = wrist == 0 ? 1.0 : -1.0;
            const Forearm forearm(f_, plane, bend, d);
            turn(3, flip * forearm.k3x, flip * plane.k_across, d, all);
          }
          if (all.verdict == Verdict::dead) continue;
          if (all.verdict == Verdict::inside) but_for_first[shoulder] = Verdict::inside;
          all.verdict = both(first.verdict, all.verdict);
          all.bounds.append(first.bounds);
          if (all.verdict == Verdict::inside) {
            out.clear();
            return Verdict::inside;
          }
          arm::or_else(all, possible);
        }
      }
    }
    // Of t1 and t1 + 180 deg a range of half a turn holds one.
    if (f_.max[0] - f_.min[0] >= kHalfTurn - 1e-12 && but_for_first[0] == Verdict::inside &&
        but_for_first[1] == Verdict::inside) {
      out.clear();
      return Verdict::inside;
    }
    if (possible.verdict == Verdict::undecided) out.append(possible.bounds);
    return possible.verdict;
  }

 private:
  using Terms = arm::Terms;
  static constexpr double kHalfTurn = arm::kHalfTurn, kTurn = arm::kTurn, kScale = arm::kScale;
  static constexpr double kSlack = arm::kSlack, kInfinity = arm::kInfinity;

  [[nodiscard]] bool free_turn(std::size_t joint) const {
    return arm::turns_freely(f_.min[joint], f_.max[joint], mask_, joint);
  }
  /// The range of joint i as angles of the Denavit-Hartenberg table, rising.
  [[nodiscard]] std::array<double, 2> range(std::size_t i) const {
    const double at_min = f_.offset[i] + f_.sign[i] * f_.min[i], at_max = f_.offset[i] + f_.sign[i] * f_.max[i];
    return {std::min(at_min, at_max), std::max(at_min, at_max)};
  }

  static void add(const FirstOrder& f, int limit, const Domain& d, Terms& terms) { arm::add(f, limit, d, terms); }
  static void below_only(const Terms& enough, int limit, Terms& terms) { arm::below_only(enough, limit, terms); }
  static void either(const Terms& a, const Terms& b, int limit, Terms& terms) { arm::either(a, b, limit, terms); }
  void turn(std::size_t i, const FirstOrder& x, const FirstOrder& y, const Domain& d, Terms& terms) const {
    arm::keep_turn(turn_[i], static_cast<int>(2 * i), x, y, d, terms);
  }

  /// Joint 2's range, as `turn`, of the upper arm's direction.
  void turn_upper_arm(const ArmPlane& plane, double sigma, const Domain& d, Terms& terms) const {
    const arm::Turn& range = turn_[1];
    if (range.free) return;
    const auto from = [&](double c, double s, bool left, int limit, Terms& kept) {
      half_plane(c * plane.rho + s * plane.height, c * plane.height - s * plane.rho, plane.along_upper,
                 left ? sigma : -sigma, sigma, limit, d, kept);
    };
    if (range.common) {
      from(range.cos_low, range.sin_low, true, 2, terms);
      if (terms.verdict == Verdict::dead) return;
      from(range.cos_high, range.sin_high, false, 3, terms);
      return;
    }
    Terms above, below;
    from(range.cos_low, range.sin_low, true, 2, above);
    if (above.verdict == Verdict::inside) return;
    from(range.cos_high, range.sin_high, false, 3, below);
    either(above, below, 2, terms);
  }

  /// A link's direction u on one side of a direction e, cross(e, u) >= 0 (`sense` = sigma) or <= 0 (-sigma). Of u it
  /// is known that it stands sigma psi from the way W to the wrist centre, 0 <= psi <= 180 deg, and that u . W = P.
  /// With A = e . W and B = cross(e, W), scaled like P: where sigma B < 0, u and e lie on the same side of W and the
  /// less they turn from it, the greater their products with W: the sign of cross(e, u) is that of sigma (A - P). Where
  /// sigma B > 0, the same holds of u and -e: it is that of sigma (A + P). None of it has a root that the stretched
  /// elbow makes steep.
  static void half_plane(const FirstOrder& A, const FirstOrder& B, const FirstOrder& P, double sense, double sigma,
                         int limit, const Domain& d, Terms& terms) {
    const double at = -sigma * B.value, spread = B.radius(d);
    if (at > spread + kSlack) return add(sense * (A - P), limit, d, terms);
    if (at < -spread - kSlack) return add(sense * (A + P), limit, d, terms);
    Terms same, opposite;
    add(sense * (A - P), limit, d, same);
    add(sense * (A + P), limit, d, opposite);
    if (same.verdict == Verdict::inside && opposite.verdict == Verdict::inside) return;
    if (same.verdict == Verdict::dead && opposite.verdict == Verdict::dead) {
      terms.verdict = both(terms.verdict, Verdict::dead);
    } else if (opposite.verdict == Verdict::dead) {
      add((-sigma) * B, limit, d, terms);
      terms.append(same);
    } else if (same.verdict == Verdict::dead) {
      add(sigma * B, limit, d, terms);
      terms.append(opposite);
    } else {  // kept where both are
      same.append(opposite);
      below_only(same, limit, terms);
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

  /// The limits of joint 5: k . u = -sin t5 of the axis k and the forearm u.
  void keep_axis(const HalfCircle& range, const ArmPlane& plane, double bend, const Domain& d, Terms& terms) const {
    if (range.verdict != Verdict::undecided) {
      terms.verdict = both(terms.verdict, range.verdict);
      return;
    }
    if (range.from) at_most(1, -range.sine_from, plane, bend, 8, d, terms);
    if (terms.verdict == Verdict::dead) return;
    if (range.to) at_most(-1, range.sine_to, plane, bend, 9, d, terms);
  }

  /// sign k . u <= most. With q = sign times the part of k in the arm's plane, the forearm's direction may not lie in
  /// the arc of half width gamma, |q| cos gamma = most, about q: it keeps one of two half planes, or both if the arc is
  /// longer than half a turn, whose edges are (most q +- S q_left) / |q|^2, S^2 = |q|^2 - most^2.
  void at_most(double sign, double most, const ArmPlane& plane, double bend, int limit, const Domain& d,
               Terms& terms) const {
    constexpr double kFlat = 0.9;
    const FirstOrder S2 = plane.k_plane2 - most * most;
    const double radius = S2.radius(d);
    if (S2.value + radius < 0) {  // the axis stands off the plane too far
      if (most < 0) terms.verdict = both(terms.verdict, Verdict::dead);
      return;
    }
    if (most > kFlat || (most > 0 && S2.value - radius <= 0)) return keep_off(sign, most, plane, bend, limit, d, terms);
    if (most < -kFlat || S2.value - radius <= 0) {
      const Forearm forearm(f_, plane, bend, d);
      return add(FirstOrder(most) - sign * forearm.k3z, limit, d, terms);
    }
    const FirstOrder S = root(S2, d);
    const FirstOrder dot = (sign * most) * plane.k_dot, cross = (sign * most) * plane.k_cross;
    const FirstOrder S_dot = sign * times(S, plane.k_dot, d), S_cross = sign * times(S, plane.k_cross, d);
    const FirstOrder P = times(plane.k_plane2, plane.along_forearm, d);
    Terms left, right;
    half_plane(dot + S_cross, cross - S_dot, P, -bend, -bend, limit, d, left);
    if (most >= 0 && left.verdict == Verdict::inside) return;
    half_plane(dot - S_cross, cross + S_dot, P, bend, -bend, limit, d, right);
    if (most >= 0) return either(left, right, limit, terms);
    terms.append(left);
    terms.append(right);
  }

  /// The same where the arc is short: a thin cone of axes about the forearm is forbidden, |v| >= least of the part v of
  /// the axis square to it, v = (its part in the plane, k_across). A half plane of v, n . v >= least, is enough, n =
  /// (side cos, sin) of the angle that leads to the nearest direction of the patch: then the part in the plane is to be
  /// `width` = (least - sin k_across) / cos at least.
  /// The other way round, a position is lost if some path of directions, along which k_across is what it is at the
  /// point of contact, starts where the forearm has not yet left the cone on one side and ends where it has not yet on
  /// the other: between them it is inside. The path may move with the position.
  void keep_off(double sign, double most, const ArmPlane& plane, double bend, int limit, const Domain& d,
                Terms& terms) const {
    const double least = std::sqrt((1 - most) * (1 + most)), sigma = -bend;
    const FirstOrder& across = plane.k_across;
    const double across_radius = across.radius(d);
    if (std::abs(across.value) - across_radius >= least + kRounding) return;
    const FirstOrder dot = sign * plane.k_dot, cross = sign * plane.k_cross;
    const FirstOrder P = times(plane.k_plane2, plane.along_forearm, d);
    // v at the middle, and the point of the patch where it is shortest, both only for the choice of n.
    const double k_plane = std::sqrt(std::max(0.0, plane.k_plane2.value));
    double side = 1, tangent = 0;
    {
      const double turned = std::max(std::abs(cross.value), 1e-9);
      const FirstOrder in_plane = (sigma / turned) * (k_plane * dot - P);
      Eigen::Vector2d v(in_plane.value, across.value);
      Eigen::Matrix2d J;
      J << in_plane.gradient[3], in_plane.gradient[4], across.gradient[3], across.gradient[4];
      if (std::abs(J.determinant()) > 1e-6 * J.squaredNorm()) v += J * d.patch->nearest(-(J.inverse() * v));
      side = v[0] >= 0 ? 1 : -1;
      if (v.norm() > 0.5 * least && std::abs(v[1]) < 3 * std::abs(v[0])) tangent = v[1] / std::abs(v[0]);
    }
    const double over_cos = std::sqrt(1 + tangent * tangent);
    const FirstOrder width = FirstOrder(least * over_cos) - tangent * across;
    const FirstOrder C2 = plane.k_plane2 - square(width, d);
    if (!(C2.value - C2.radius(d) > 0)) {
      const Forearm forearm(f_, plane, bend, d);
      return add(FirstOrder(most) - sign * forearm.k3z, limit, d, terms);
    }
    const FirstOrder C = root(C2, d);
    const FirstOrder C_dot = times(C, dot, d), C_cross = times(C, cross, d);
    const FirstOrder width_dot = times(width, dot, d), width_cross = times(width, cross, d);
    const auto off = [&](double s) {  // >= 0 where the forearm stands off on this side
      return (s * sigma) * (C_dot + s * width_cross - P);
    };
    const auto keeps = [&](double s) {
      Terms kept;
      half_plane(C_dot + s * width_cross, C_cross - s * width_dot, P, s * sigma, sigma, limit, d, kept);
      return kept;
    };
    const Terms kept = keeps(side);
    if (kept.verdict == Verdict::inside) return;
    // Whether both edges certainly stand on the forearm's side of the way to the wrist centre, so that no turn is lost.
    const double cross_low = -sigma * cross.value - cross.radius(d), dot_most = std::abs(dot.value) + dot.radius(d);
    const double C_low = C.value - C.radius(d), width_most = std::abs(width.value) + width.radius(d);
    const bool clear = C_low * cross_low > width_most * dot_most + kSlack;
    if (!clear && keeps(-side).verdict == Verdict::inside) return;
    below_only(kept, limit, terms);
    if (!clear || !std::isfinite(P.radius(d))) return;

    const Eigen::Vector2d slope(across.gradient[3], across.gradient[4]);
    const Vec3 by_position(across.gradient[0], across.gradient[1], across.gradient[2]);
    Eigen::Vector2d at_left = Eigen::Vector2d::Zero(), at_right = at_left, n = at_left;
    Vec3 shift = Vec3::Zero();   // of the path along n
    double error = across.rest;  // of k_across on the path
    const double target = least * tangent / over_cos, steep = slope.norm();
    const FirstOrder near = off(side), other = off(-side);
    if (steep > 1e-9) {
      n = slope / steep;
      const double from = d.patch->least(n[0], n[1]), to = -d.patch->least(-n[0], -n[1]);
      const double middle = (target - across.value) / steep, half = by_position.cwiseAbs().dot(d.half) / steep;
      const Eigen::Vector2d along(-n[1], n[0]);
      double first = 0, last = 0, at = 0, reach = 0;
      const auto fits = [&](double share) {  // a path that keeps to this share of the patch
        double low = std::max(middle - half, share * from), high = std::min(middle + half, share * to);
        if (low > high) low = high = std::clamp(middle, share * from, share * to);
        at = 0.5 * (low + high);
        reach = 0.5 * (high - low);
        first = -kInfinity;
        last = kInfinity;
        return d.patch->clip(low * n, along, first, last) && d.patch->clip(high * n, along, first, last);
      };
      if (!fits(1) && !fits(0.8) && !fits(0.5)) return;
      error += steep * (std::abs(at - middle) + half - reach);
      if (half > 0) shift = (-reach / (half * steep)) * by_position;
      const double rise = near.gradient[3] * along[0] + near.gradient[4] * along[1];
      at_left = at * n + (rise > 0 ? first : last) * along;
      at_right = at * n + (rise > 0 ? last : first) * along;
    } else {
      error += std::abs(across.value - target) + across_radius;
    }
    const double width_least = least / over_cos - std::abs(tangent) * error;
    if (!(width_least > error * over_cos)) return;
    // The true edge lies farther out than that of `width`, which touches it.
    const double extra = error * error * over_cos * over_cos *
                         (dot_most / most + (std::abs(cross.value) + cross.radius(d)) / width_least);
    const auto most_at = [&](const FirstOrder& f, const Eigen::Vector2d& at, Vec3& G) {
      G = Vec3(f.gradient[0], f.gradient[1], f.gradient[2]) + (f.gradient[3] * n[0] + f.gradient[4] * n[1]) * shift;
      return f.value + f.gradient[3] * at[0] + f.gradient[4] * at[1] + f.rest + extra + kRounding * kScale;
    };
    Vec3 G;
    if (!(most_at(other, at_right, G) + G.cwiseAbs().dot(d.half) < 0)) return;
    const double M = most_at(near, at_left, G);
    if (M + G.cwiseAbs().dot(d.half) < 0) {
      terms.verdict = both(terms.verdict, Verdict::outside);
    } else {
      terms.bounds.push_back({limit, kInfinity, M, G});
    }
  }

  machine::WristInverse::Form f_;
  LimitBits mask_;
  std::array<arm::Turn, 5> turn_{};
  std::array<HalfCircle, 2> elbow_, wrist_;
};

/// What volume() asks over boxes: one for each closed inverse, those of five and six joints with one freedom more, too.
using SerialLimits =
    std::variant<ArmLimits, SixJointLimits, ThreeParallelLimits, CartesianLimits, ScaraLimits, OneMoreLimits<ArmLimits>,
                 OneMoreLimits<SixJointLimits>, OneMoreLimits<ThreeParallelLimits>>;

/// Of an arm with the closed inverse of five or six joints: `wrap` of its bounds.
template <class Wrap>
std::optional<SerialLimits> closed_bounds_of(const machine::SerialArm& arm, LimitBits limits, const Wrap& wrap) {
  if (const auto closed = machine::WristInverse::of(arm)) return wrap(ArmLimits(closed->form(), limits));
  if (const auto closed = machine::SphericalWristInverse::of(arm))
    if (const auto form = closed->form()) return wrap(SixJointLimits(*form, limits));
  if (const auto closed = machine::ThreeParallelInverse::of(arm)) {
    const auto form = closed->form();
    if (form && ThreeParallelLimits::serves(*form, limits)) return wrap(ThreeParallelLimits(*form, limits));
  }
  return {};
}

/// Of an arm as RedundantInverse takes it: six joints whose task leaves the turn about the tool axis free, or one that
/// a rail or a turntable carries.
inline std::optional<SerialLimits> one_more_bounds_of(const machine::SerialArm& arm, LimitBits limits,
                                                      double tolerance) {
  if (arm.free_joints() != arm.task.size() + 1 || arm.is_coupled()) return {};
  OneMore more;
  const auto with_more = [&]<class Inner>(Inner inner) {
    return SerialLimits(OneMoreLimits<Inner>(std::move(inner), more, tolerance));
  };
  if (arm.task == machine::Task::axis) {
    machine::SerialArm inner = arm;
    inner.task = machine::Task::pose;
    more.from = -std::numbers::pi;
    more.to = std::numbers::pi;
    if (auto spun = closed_bounds_of(inner, limits, with_more)) return spun;
  }
  const auto first = std::find_if(arm.dh.begin(), arm.dh.end(), [](const machine::DhRow& r) { return !r.locked; });
  const auto carried = machine::CarriedArm::of(arm, static_cast<std::size_t>(first - arm.dh.begin()));
  if (!carried) return {};
  const machine::JointRange range = carried->range();
  more.from = range.min;
  more.to = range.max;
  const bool slides = carried->axis().kind == machine::JointKind::prismatic;
  more.kind = slides ? OneMore::Kind::rail : OneMore::Kind::turntable;
  std::tie(more.axis, more.point) = carried->line();
  if (!slides && arm::turns_freely(range.min, range.max, limits, 0)) {
    more.from = -std::numbers::pi;
    more.to = std::numbers::pi;
  }
  return closed_bounds_of(carried->arm(), limits >> 2, with_more);
}

/// Of a six-joint arm whose joint 2 turns joint 3, too, as much as itself.
inline std::optional<SerialLimits> coupled_bounds_of(const machine::SerialArm& arm, LimitBits limits) {
  machine::SerialArm without = arm;
  std::vector<int> joint_of;
  int joints = 0, coupling = 0;
  for (std::size_t i = 0; i < arm.dh.size(); ++i) {
    const machine::DhRow& row = arm.dh[i];
    joint_of.push_back(row.locked ? -1 : joints++);
    if (row.coupled_back == 0) continue;
    const double factor = row.sign * row.coupling;
    const bool third_by_second =
        joint_of[i] == 2 && joint_of[i - static_cast<std::size_t>(row.coupled_back)] == 1 && std::abs(factor) == 1;
    if (!third_by_second) return {};
    coupling = factor > 0 ? 1 : -1;
    without.dh[i].coupled_back = 0;
    without.dh[i].coupling = 0;
  }
  const auto closed = machine::SphericalWristInverse::of(without);
  const auto form = closed ? closed->form() : std::nullopt;
  if (!form) return {};
  return SixJointLimits(*form, limits, coupling);
}

/// Errors: WS102 (neither the wrist of WristInverse, nor a right-angled one of SphericalWristInverse, nor one of
/// ThreeParallelInverse with joint 3 alone limited, these three with one freedom more or not, nor one of
/// CartesianInverse, its third rotary axis, if there is one, without limits, nor a SCARA robot).
inline Result<SerialLimits> bounds_of(const machine::SerialArm& arm, const Options& options) {
  if (arm.is_coupled()) {
    if (auto coupled = coupled_bounds_of(arm, options.limits)) return *std::move(coupled);
    return no_bounds(arm.name);
  }
  const auto alone = [](auto limits) { return SerialLimits(std::move(limits)); };
  if (auto closed = closed_bounds_of(arm, options.limits, alone)) return *std::move(closed);
  if (const auto closed = machine::CartesianInverse::of(arm))
    if (CartesianLimits::serves(closed->form(), options.limits)) return CartesianLimits(closed->form(), options.limits);
  if (const auto closed = machine::ScaraInverse::of(arm)) return ScaraLimits(closed->form(), options.limits);
  if (auto redundant = one_more_bounds_of(arm, options.limits, options.relative_tolerance))
    return *std::move(redundant);
  return no_bounds(arm.name);
}
inline bool bounded(const machine::SerialArm& arm) {
  return bounds_of(arm, Options{}).has_value();
}
/// Whether a box takes far longer than a pose: what only narrows down a search is then left loose.
inline bool bounds_are_slow(const machine::SerialArm& arm) {
  return one_more_bounds_of(arm, Options{}.limits, 1).has_value();
}

}  // namespace polypod::workspace
