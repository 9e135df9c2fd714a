// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The limits of hexapods over a box of positions and a patch of directions, each in first order with a bound on the
// rest.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numbers>

#include "../../workspace/linear.hpp"
#include "polypod/families/hexapod/slider_kinematics.hpp"
#include "polypod/families/hexapod/strut_kinematics.hpp"

namespace polypod::workspace {

using machine::HexapodLimits;
using machine::JointLimit;
using machine::JointLimitKind;
using machine::kLegs;
using machine::SliderHexapod;
using machine::StrutHexapod;

/// A vector that turns with the tool over a patch: v(s, t) = v + v1 s + v2 t + rest, |rest| <= bend,
/// |v(s, t) - v| <= turn.
struct Turning {
  Vec3 v = Vec3::Zero(), v1 = Vec3::Zero(), v2 = Vec3::Zero();
  double bend = 0, turn = 0, norm = 0;
};
inline Turning turning(const Patch& patch, const Vec3& in_tool) {
  Turning t;
  t.v = patch.R * in_tool;
  t.v1 = patch.omega1.cross(t.v);
  t.v2 = patch.omega2.cross(t.v);
  t.norm = in_tool.norm();
  t.bend = patch.bend * t.norm;
  t.turn = patch.turn * t.norm;
  return t;
}

/// A normal of a joint limit, g = sign (y . n - kappa |y|) >= 0 for the leg y; n stands still or turns with the tool.
struct JointTerm {
  int limit = 0;
  bool of_platform = false;
  Vec3 n = Vec3::Zero();  ///< in M for the base, in P for the platform
  double kappa = 0;
  double sign = 1;
};

/// The joint limits of one leg as such terms (see joint_margin for their meaning).
template <class Hexapod>
std::vector<JointTerm> joint_terms(const Hexapod& m, int leg, LimitBits mask) {
  std::vector<JointTerm> out;
  for (const bool of_platform : {false, true}) {
    const int bit = (of_platform ? HexapodLimits::kPlatformJoint : HexapodLimits::kBaseJoint) + leg;
    if ((mask >> bit & 1U) == 0) continue;
    const machine::JointSeats& seats = of_platform ? m.platform_seats : m.base_seats;
    const JointLimit limit = machine::hexapod_detail::limit_of(m.joint, seats, leg);
    const Vec3& home = machine::hexapod_detail::axis_of(seats, m.home, leg);
    switch (limit.kind) {
      case JointLimitKind::none:
        break;
      case JointLimitKind::cone:
        if (limit.angle < std::numbers::pi) out.push_back({bit, of_platform, home, std::cos(limit.angle), 1});
        break;
      case JointLimitKind::elevation: {
        const auto height = machine::hexapod_detail::elevations(home, std::cos(limit.angle), std::sin(limit.angle));
        if (height.high < 1) out.push_back({bit, of_platform, Vec3::UnitZ(), height.high, -1});
        if (height.low > -1) out.push_back({bit, of_platform, Vec3::UnitZ(), height.low, 1});
        break;
      }
      case JointLimitKind::pyramid:
        for (const Vec3& n : machine::pyramid_normals(home, limit)) out.push_back({bit, of_platform, n, 0, 1});
        break;
    }
  }
  return out;
}

/// sign (y . n - kappa |y|) for y = c + v - a, |dy| <= eta.
inline Linear joint_linear(const JointTerm& term, const Turning& n, const Vec3& y, double length, const Turning& v,
                           double radius) {
  Linear f;
  const double eta = radius + v.turn;
  f.value = term.sign * (y.dot(n.v) - term.kappa * length);
  const double least = length - eta;
  const double turning_normal = term.of_platform ? length * n.bend + eta * n.turn : 0.0;
  const double s1 = term.of_platform ? y.dot(n.v1) : 0.0, s2 = term.of_platform ? y.dot(n.v2) : 0.0;
  if (term.kappa != 0 && !(least > 0.1 * length)) {  // close to the joint itself the direction is anything
    f.below = f.above = (1 + std::abs(term.kappa)) * eta + (term.of_platform ? (length + eta) * n.turn : 0.0);
    return f;
  }
  Vec3 g = n.v;
  double curvature = 0;
  if (term.kappa != 0) {
    g -= (term.kappa / length) * y;
    curvature = std::abs(term.kappa) * eta * eta / (2 * least);
  }
  f.G = term.sign * g;
  f.s1 = term.sign * (g.dot(v.v1) + s1);
  f.s2 = term.sign * (g.dot(v.v2) + s2);
  const double rest = g.norm() * v.bend + turning_normal;
  // -kappa |y| is concave for kappa > 0: its rest is never positive.
  const bool bends_down = term.kappa * term.sign > 0;
  f.below = rest + (bends_down ? curvature : 0.0);
  f.above = rest + (bends_down ? 0.0 : curvature);
  return f;
}

/// Two legs against each other, in first order whether they are closest inside or at their ends. `point(n, s, t)` is
/// n . (P - Q) for the points P, Q at s and t of the legs (0: base, 1: platform) and a vector n that stands still, in
/// first order; `way(s, t)` bounds how far P - Q moves.
///  - At most they are as far apart as the points that are closest at the middle of cell and patch:
///    |P - Q| <= n . (P - Q) + way^2 / (2 (distance - way)) with n along P - Q at the middle.
///  - At least they are as far apart as the planes square to n between which no leg reaches: the least of n . (P - Q)
///    over the four pairs of ends.
template <class Point, class Way>
Verdict weigh_pair(int limit, double diameter, const std::array<Vec3, 4>& ends, const Point& point, const Way& way,
                   const Vec3& half, const Patch& patch, BoundList& out) {
  const auto& [base_i, platform_i, base_j, platform_j] = ends;
  const Vec3 leg_i = platform_i - base_i, leg_j = platform_j - base_j;
  const ClosestParameters closest = closest_parameters(base_i, leg_i, base_j, leg_j);
  const Vec3 between = base_i + closest.s * leg_i - base_j - closest.t * leg_j;
  const double distance = between.norm(), slack = kRounding * (leg_i.norm() + leg_j.norm());
  const double moved = way(closest.s, closest.t);
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  if (!(distance > 1.1 * moved)) {
    if (distance + moved + slack < diameter) return Verdict::outside;
    return Verdict::open;
  }
  const Vec3 n = between / distance;
  const Linear gap = point(n, closest.s, closest.t);
  const double most =
      gap.value - diameter + patch.least(gap.s1, gap.s2) + gap.above + moved * moved / (2 * (distance - moved)) + slack;
  if (most + gap.G.cwiseAbs().dot(half) < 0) return Verdict::outside;
  bool clear = true;
  for (const double s : {0.0, 1.0})
    for (const double t : {0.0, 1.0}) {
      const Linear f = point(n, s, t);
      const double least = f.value - diameter + patch.least(f.s1, f.s2) - f.below - slack;
      if (least - f.G.cwiseAbs().dot(half) >= 0) continue;
      clear = false;
      if (!out.push_back({limit + 1000 + static_cast<int>(2 * s + t), least, kInfinity, f.G})) return Verdict::open;
    }
  if (clear) return Verdict::inside;
  return out.push_back({limit, kInfinity, most, gap.G}) ? Verdict::undecided : Verdict::open;
}

/// What both families need of a patch.
struct HexapodData {
  std::array<Turning, kLegs> end;    ///< tool tip to platform joint
  std::vector<Turning> term_normal;  ///< of the terms of all legs, in their order
};

template <class Hexapod>
class HexapodBase {
 public:
  using Data = HexapodData;

  HexapodBase(const Hexapod& m, const Options& options) : m_(m), mask_(options.limits) {
    for (int i = 0; i < kLegs; ++i) {
      end_[i] = m.platform_joint[i] - Vec3(0, 0, m.tool_length);
      lever_ = std::max(lever_, end_[i].norm());
      first_term_[i] = static_cast<int>(terms_.size());
      for (const JointTerm& t : joint_terms(m, i, mask_)) terms_.push_back(t);
    }
    first_term_[kLegs] = static_cast<int>(terms_.size());
    int bit = HexapodLimits::kLegPair;
    for (int i = 0; i < kLegs; ++i)
      for (int j = i + 1; j < kLegs; ++j, ++bit)
        if (options.interference && m.leg_diameter > 0 && (mask_ >> bit & 1U) != 0) pairs_.push_back({i, j, bit});
    for (int k = 0; k < 3; ++k) {
      if (heeds(HexapodLimits::kLow + k) && std::isfinite(m.low[k])) tip_.push_back({k, 1, m.low[k]});
      if (heeds(HexapodLimits::kHigh + k) && std::isfinite(m.high[k])) tip_.push_back({k, -1, m.high[k]});
    }
  }

  /// One a leg, one a pair of legs, one for the coordinates of the tip.
  [[nodiscard]] int groups() const { return kLegs + static_cast<int>(pairs_.size()) + (tip_.empty() ? 0 : 1); }
  [[nodiscard]] double lever() const { return lever_; }

  [[nodiscard]] static std::size_t bytes(const Data& d) { return d.term_normal.capacity() * sizeof(Turning); }
  [[nodiscard]] Data prepare(const Patch& patch) const {
    Data d;
    for (int i = 0; i < kLegs; ++i) d.end[i] = turning(patch, end_[i]);
    for (const JointTerm& t : terms_) {
      if (t.of_platform) {
        d.term_normal.push_back(turning(patch, t.n));
      } else {
        Turning still;
        still.v = t.n;
        still.norm = 1;
        d.term_normal.push_back(still);
      }
    }
    return d;
  }

 protected:
  struct Pair {
    int i, j, bit;
  };
  /// sign (x_axis - at) >= 0 of the tool tip.
  struct TipLimit {
    int axis;
    double sign, at;
  };
  [[nodiscard]] bool heeds(int limit) const { return (mask_ >> limit & 1U) != 0; }

  /// The coordinates are the group behind those of the pairs.
  [[nodiscard]] bool is_tip(int group) const { return group == kLegs + static_cast<int>(pairs_.size()); }
  Verdict judge_tip(const Vec3& center, const Vec3& half, const Patch& patch, BoundList& out) const {
    Verdict verdict = Verdict::inside;
    for (const TipLimit& limit : tip_) {
      Linear f;
      f.value = limit.sign * (center[limit.axis] - limit.at);
      f.G[limit.axis] = limit.sign;
      const int id = 300 + (limit.sign > 0 ? limit.axis : 3 + limit.axis);
      verdict = both(verdict, weigh(f, id, std::abs(center[limit.axis]) + std::abs(limit.at), half, patch, out));
      if (verdict == Verdict::outside || verdict == Verdict::dead) break;
    }
    return verdict;
  }
  /// The box cut to the coordinate limits of the tip.
  void cut_to_tip(Vec3& low, Vec3& high) const {
    for (const TipLimit& limit : tip_) {
      double& end = limit.sign > 0 ? low[limit.axis] : high[limit.axis];
      end = limit.sign > 0 ? std::max(end, limit.at) : std::min(end, limit.at);
    }
  }

  const Hexapod& m_;
  LimitBits mask_;
  std::array<Vec3, kLegs> end_;
  double lever_ = 0;
  std::vector<JointTerm> terms_;
  std::array<int, kLegs + 1> first_term_{};
  std::vector<Pair> pairs_;
  std::vector<TipLimit> tip_;
};

class StrutLimits : public HexapodBase<StrutHexapod> {
 public:
  using HexapodBase::HexapodBase;

  /// The largest lengths of the struts.
  [[nodiscard]] static LimitBits ends() { return LimitBits{0x3f} << HexapodLimits::kMax; }
  void box(Vec3& low, Vec3& high, const Directions& directions) const {
    const Patch patch = whole_patch(directions);
    low = Vec3::Constant(-1e9);
    high = Vec3::Constant(1e9);
    for (int i = 0; i < kLegs; ++i) {  // the tip with any one direction of the set
      const Vec3 center = m_.base_joint[i] - patch.R * end_[i];
      low = low.cwiseMax(center - Vec3::Constant(m_.length_max));
      high = high.cwiseMin(center + Vec3::Constant(m_.length_max));
    }
    cut_to_tip(low, high);
  }

  Verdict judge(int group, const Vec3& center, const Vec3& half, double radius, const Patch& patch, const Data& d,
                BoundList& out) const {
    if (is_tip(group)) return judge_tip(center, half, patch, out);
    if (group >= kLegs)
      return judge_pair(pairs_[static_cast<std::size_t>(group - kLegs)], center, half, radius, patch, d, out);
    const int i = group;
    const Turning& v = d.end[i];
    const Vec3 y = center + v.v - m_.base_joint[i];
    const double square = y.squaredNorm(), length = std::sqrt(square), eta = radius + v.turn;
    const double bend = 2 * length * v.bend;
    Linear f;
    f.G = 2 * y;
    f.s1 = 2 * y.dot(v.v1);
    f.s2 = 2 * y.dot(v.v2);
    f.value = square - m_.length_min * m_.length_min;
    f.below = bend;
    f.above = bend + eta * eta;
    const double scale = square + m_.length_max * m_.length_max;
    Verdict verdict = Verdict::inside;
    if (heeds(HexapodLimits::kMin + i) && m_.length_min > 0) {
      verdict = both(verdict, weigh(f, HexapodLimits::kMin + i, scale, half, patch, out));
      if (verdict == Verdict::outside || verdict == Verdict::dead) return verdict;
    }
    if (heeds(HexapodLimits::kMax + i)) {
      f.G = -f.G;
      f.s1 = -f.s1;
      f.s2 = -f.s2;
      f.value = m_.length_max * m_.length_max - square;
      std::swap(f.below, f.above);
      verdict = both(verdict, weigh(f, HexapodLimits::kMax + i, scale, half, patch, out));
      if (verdict == Verdict::outside || verdict == Verdict::dead) return verdict;
    }
    for (int k = first_term_[i]; k < first_term_[i + 1]; ++k) {
      const JointTerm& term = terms_[static_cast<std::size_t>(k)];
      const Linear g = joint_linear(term, d.term_normal[static_cast<std::size_t>(k)], y, length, v, radius);
      verdict = both(verdict, weigh(g, 64 + k, length, half, patch, out));
      if (verdict == Verdict::outside || verdict == Verdict::dead) return verdict;
    }
    return verdict;
  }

 private:
  /// Axes of legs i and j against the diameter. From below by the distance of the two lines, a smooth function that is
  /// never above that of the segments, or by the segments' distance and how far their ends move; from above by the
  /// distance of the two points that are closest at the middle.
  Verdict judge_pair(const Pair& pair, const Vec3& center, const Vec3& half, double radius, const Patch& patch,
                     const Data& d, BoundList& out) const {
    const Turning &vi = d.end[pair.i], &vj = d.end[pair.j];
    const Vec3 &ai = m_.base_joint[pair.i], &aj = m_.base_joint[pair.j];
    const Vec3 yi = center + vi.v - ai, yj = center + vj.v - aj;
    const auto point = [&](const Vec3& n, double s, double t) {
      Linear f;
      f.value = n.dot(ai + s * yi - aj - t * yj);
      f.G = (s - t) * n;
      f.s1 = n.dot(s * vi.v1 - t * vj.v1);
      f.s2 = n.dot(s * vi.v2 - t * vj.v2);
      f.below = f.above = s * vi.bend + t * vj.bend;
      return f;
    };
    const auto way = [&](double s, double t) { return std::abs(s - t) * radius + s * vi.turn + t * vj.turn; };
    return weigh_pair(pair.bit, m_.leg_diameter, {ai, ai + yi, aj, aj + yj}, point, way, half, patch, out);
  }
};

class SliderLimits : public HexapodBase<SliderHexapod> {
 public:
  using HexapodBase::HexapodBase;

  /// The ends of the rails.
  [[nodiscard]] static LimitBits ends() {
    return LimitBits{0x3f} << HexapodLimits::kMin | LimitBits{0x3f} << HexapodLimits::kMax;
  }
  void box(Vec3& low, Vec3& high, const Directions& directions) const {
    const Patch patch = whole_patch(directions);
    low = Vec3::Constant(-1e9);
    high = Vec3::Constant(1e9);
    for (int i = 0; i < kLegs; ++i) {
      const Vec3 shift = patch.R * end_[i], reach = Vec3::Constant(m_.length_of_leg(i));
      low = low.cwiseMax(m_.rail_outer[i].cwiseMin(m_.rail_inner[i]) - shift - reach);
      high = high.cwiseMin(m_.rail_outer[i].cwiseMax(m_.rail_inner[i]) - shift + reach);
    }
    cut_to_tip(low, high);
  }

  Verdict judge(int group, const Vec3& center, const Vec3& half, double radius, const Patch& patch, const Data& d,
                BoundList& out) const {
    if (is_tip(group)) return judge_tip(center, half, patch, out);
    if (group >= kLegs)
      return judge_pair(pairs_[static_cast<std::size_t>(group - kLegs)], center, half, radius, patch, d, out);
    const int i = group;
    Leg leg;
    const Verdict reach = reach_of(i, center, half, radius, patch, d, leg, out);
    if (reach == Verdict::outside || reach == Verdict::dead) return reach;
    // The root nearer the outer end, or, where that is beyond the end, the other one.
    BoundList by_outer, by_inner;
    const Verdict outer = branch(i, -1, leg, half, patch, d, by_outer);
    if (outer == Verdict::inside) return reach;
    const Verdict inner = branch(i, 1, leg, half, patch, d, by_inner);
    if (inner == Verdict::inside) return reach;
    if (inner == Verdict::dead) {  // only the outer root is possible, in all directions
      out.append(by_outer);
      return both(reach, outer);
    }
    if (outer == Verdict::dead) {
      out.append(by_inner);
      return both(reach, inner);
    }
    return Verdict::open;
  }

 private:
  /// Leg i over the cell: y = c + v - a, its part across the rail, and S = sqrt(l^2 - |across|^2) in first order.
  struct Leg {
    Vec3 y, across, u;
    double along = 0, eta = 0, radius = 0;
    double S = 0, S_low = 0, S_high = 0;
    Vec3 S_gradient;
    double S_below = 0, S_above = 0;
    const Turning* v = nullptr;
  };

  Verdict reach_of(int i, const Vec3& center, const Vec3& half, double radius, const Patch& patch, const Data& d,
                   Leg& leg, BoundList& out) const {
    const Turning& v = d.end[i];
    leg.v = &v;
    leg.u = m_.rail_direction[i];
    leg.y = center + v.v - m_.rail_outer[i];
    leg.along = leg.u.dot(leg.y);
    leg.across = leg.y - leg.along * leg.u;
    leg.radius = radius;
    leg.eta = radius + v.turn;
    const double l2 = m_.length_of_leg(i) * m_.length_of_leg(i), a2 = leg.across.squaredNorm(), a = std::sqrt(a2);
    const double S2 = l2 - a2;
    Linear f;
    f.value = S2;
    f.G = -2 * leg.across;
    f.s1 = -2 * leg.across.dot(v.v1);
    f.s2 = -2 * leg.across.dot(v.v2);
    f.below = 2 * a * v.bend + leg.eta * leg.eta;
    f.above = 2 * a * v.bend;
    const Verdict verdict = weigh(f, 60 + i, l2 + a2, half, patch, out);
    if (verdict == Verdict::outside || verdict == Verdict::dead) return verdict;
    const double way = 2 * a * leg.eta + leg.eta * leg.eta;
    leg.S_low = std::sqrt(std::max(0.0, S2 - way));
    leg.S_high = std::sqrt(std::max(0.0, S2 + 2 * a * leg.eta));
    leg.S = S2 > 0 ? std::sqrt(S2) : 0.0;
    const double curvature = leg.S_low > 0 ? 0.5 * leg.eta * leg.eta * l2 / (leg.S_low * leg.S_low * leg.S_low) : 1e300;
    if (S2 > 0 && curvature < leg.S_high - leg.S_low) {
      leg.S_gradient = -leg.across / leg.S;
      leg.S_below = curvature;
      leg.S_above = 0;  // S is concave
    } else {
      leg.S_gradient.setZero();
      leg.S_below = leg.S - leg.S_low;
      leg.S_above = leg.S_high - leg.S;
    }
    return verdict;
  }

  /// p . y + s S + constant over the cell, for a vector p that stands still.
  [[nodiscard]] static Linear linear(const Leg& leg, const Vec3& p, double s, double constant) {
    Linear f;
    f.value = p.dot(leg.y) + s * leg.S + constant;
    f.G = p + s * leg.S_gradient;
    f.s1 = f.G.dot(leg.v->v1);
    f.s2 = f.G.dot(leg.v->v2);
    const double bend = f.G.norm() * leg.v->bend;
    f.below = bend + (s > 0 ? s * leg.S_below : -s * leg.S_above);
    f.above = bend + (s > 0 ? s * leg.S_above : -s * leg.S_below);
    return f;
  }

  /// All limits of leg i on the root along + beta S (beta -1: the root nearer the outer end).
  Verdict branch(int i, double beta, const Leg& leg, const Vec3& half, const Patch& patch, const Data& d,
                 BoundList& out) const {
    const double l = m_.length_of_leg(i), scale = leg.y.norm() + l;
    Verdict verdict = Verdict::inside;
    const auto add = [&](const Linear& f, int limit) {
      verdict = both(verdict, weigh(f, limit, scale, half, patch, out));
      return verdict != Verdict::dead;
    };
    if (beta > 0 && !add(linear(leg, -leg.u, 1, 0), 50 + i)) return verdict;  // the other root is off the rail
    if (heeds(HexapodLimits::kMin + i) && !add(linear(leg, leg.u, beta, 0), HexapodLimits::kMin + i)) return verdict;
    if (heeds(HexapodLimits::kMax + i) &&
        !add(linear(leg, -leg.u, -beta, m_.rail_length[i]), HexapodLimits::kMax + i)) {
      return verdict;
    }
    // k = y - (along + beta S) u = across - beta S u, of length l.
    for (int t = first_term_[i]; t < first_term_[i + 1]; ++t) {
      const JointTerm& term = terms_[static_cast<std::size_t>(t)];
      const Turning& n = d.term_normal[static_cast<std::size_t>(t)];
      const double nu = n.v.dot(leg.u);
      Linear f = linear(leg, term.sign * (n.v - nu * leg.u), -term.sign * beta * nu, -term.sign * term.kappa * l);
      if (term.of_platform) {
        const Vec3 k = leg.across - beta * leg.S * leg.u;
        f.s1 += term.sign * k.dot(n.v1);
        f.s2 += term.sign * k.dot(n.v2);
        const double k_way = leg.eta + std::max(leg.S_high - leg.S, leg.S - leg.S_low);
        const double rest = k.norm() * n.bend + k_way * n.turn;
        f.below += rest;
        f.above += rest;
      }
      if (!add(f, 64 + t)) return verdict;
    }
    if (m_.base_check && heeds(HexapodLimits::kBasePlane + i)) {
      for (int g = 0; g < 2; ++g) {
        const Vec3& n = m_.guard[i][static_cast<std::size_t>(g)];
        const double nu = n.dot(leg.u);
        if (n.isZero(0)) continue;
        if (!add(linear(leg, n - nu * leg.u, -beta * nu, 0), 200 + 2 * i + g)) return verdict;
      }
    }
    return verdict;
  }

  /// Open where a leg may stand on either root.
  Verdict judge_pair(const Pair& pair, const Vec3& center, const Vec3& half, double radius, const Patch& patch,
                     const Data& d, BoundList& out) const {
    std::array<Leg, 2> legs;
    std::array<Vec3, 4> ends;
    std::array<double, 2> slide{};  // how far the sliders move
    BoundList unused;
    for (std::size_t which = 0; which < 2; ++which) {
      const int i = which == 0 ? pair.i : pair.j;
      Leg& leg = legs[which];
      // The legs' own groups say what is out of reach.
      const Verdict reach = reach_of(i, center, half, radius, patch, d, leg, unused);
      if (reach == Verdict::outside || reach == Verdict::dead) return reach;
      const double q = leg.along - leg.S;
      const double S_way = std::max(leg.S_high - leg.S, leg.S - leg.S_low);
      if (q - leg.eta - S_way < 0) return Verdict::open;
      slide[which] = leg.eta + S_way;
      ends[2 * which] = m_.rail_outer[i] + q * leg.u;
      ends[2 * which + 1] = center + leg.v->v;
    }
    const auto of_leg = [&](std::size_t which, const Vec3& n, double s) {
      const Leg& leg = legs[which];
      const double along = (1 - s) * n.dot(leg.u);
      return linear(leg, along * leg.u + s * n, -along, n.dot(m_.rail_outer[which == 0 ? pair.i : pair.j]));
    };
    const auto point = [&](const Vec3& n, double s, double t) {
      Linear f = of_leg(0, n, s);
      const Linear g = of_leg(1, n, t);
      f.value -= g.value;
      f.G -= g.G;
      f.s1 -= g.s1;
      f.s2 -= g.s2;
      f.below += g.above;
      f.above += g.below;
      return f;
    };
    const auto way = [&](double s, double t) {
      return std::abs(s - t) * radius + s * legs[0].v->turn + t * legs[1].v->turn + (1 - s) * slide[0] +
             (1 - t) * slide[1];
    };
    return weigh_pair(pair.bit, m_.leg_diameter, ends, point, way, half, patch, out);
  }
};

/// What volume() asks of them over boxes.
inline Result<StrutLimits> bounds_of(const StrutHexapod& m, const Options& options) {
  return StrutLimits(m, options);
}
inline Result<SliderLimits> bounds_of(const SliderHexapod& m, const Options& options) {
  return SliderLimits(m, options);
}

}  // namespace polypod::workspace
