// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The limits of deltas over boxes of tool positions.
#pragma once

#include <fmt/format.h>

#include "../../workspace/first_order.hpp"
#include "../../workspace/linear.hpp"
#include "../hexapod/bounds.hpp"
#include "polypod/families/delta/kinematics.hpp"

namespace polypod::workspace {

/// Follows machine::drive_roots (first roots) in first order, and judges the limits of machine::DeltaLimits. Groups:
/// one for each chain, one for the coordinates of the tool, one for the assembly mode, one for each pair of bodies that
/// may touch. The orientation is R = 1, so patches say nothing.
template <machine::DeltaFamily M>
class DeltaBounds {
  using L = machine::DeltaLimits;

 public:
  struct Data {};

  DeltaBounds(const M& m, const Options& options) : m_(m), mask_(options.limits), singular_(options.singular_distance) {
    const auto& bodies = m.bodies;
    if (!options.interference || !(bodies.rod_diameter > 0)) return;
    for (int i = 0; i < m.arms; ++i)
      for (int j = i + 1; j < m.arms; ++j)
        if (heeds(L::rods(i, j))) pairs_.push_back({Other::rod, i, j, L::rods(i, j)});
    for (int i = 0; i < m.arms && bodies.arm_diameter > 0; ++i)
      for (int j = 0; j < m.arms; ++j)
        if (i != j && heeds(L::rod_arm(i, j))) pairs_.push_back({Other::arm, i, j, L::rod_arm(i, j)});
    for (int i = 0; i < m.arms; ++i)
      if (bodies.base_thickness > 0 && heeds(L::kBase + i)) pairs_.push_back({Other::base, i, i, L::kBase + i});
  }

  [[nodiscard]] int groups() const { return m_.arms + 2 + static_cast<int>(pairs_.size()); }
  [[nodiscard]] double lever() const { return m_.rod_length[0]; }
  [[nodiscard]] static std::size_t bytes(const Data&) { return 0; }
  [[nodiscard]] Data prepare(const Patch&) const { return {}; }

  /// The ends of the rails.
  [[nodiscard]] LimitBits ends() const {
    LimitBits bits = 0;
    if constexpr (kArms) return bits;  // its arms and rods are rigid
    for (int i = 0; i < m_.arms; ++i) bits |= LimitBits{1} << (L::kMin + i) | LimitBits{1} << (L::kMax + i);
    return bits;
  }
  void box(Vec3& low, Vec3& high, const Directions&) const {
    low = Vec3::Constant(-1e9);
    high = Vec3::Constant(1e9);
    for (int i = 0; i < m_.arms; ++i) {
      Vec3 from = start(i) - m_.platform_joint[i] + m_.tool, to = from;
      double reach = m_.rod_length[i];
      if constexpr (kArms) {
        reach += m_.arm_length[i];
      } else {
        to += m_.range.max * m_.rail_direction[i];
      }
      low = low.cwiseMax(from.cwiseMin(to) - Vec3::Constant(reach));
      high = high.cwiseMin(from.cwiseMax(to) + Vec3::Constant(reach));
    }
    for (int k = 0; k < 3; ++k) {
      if (heeds(L::kLow + k)) low[k] = std::max(low[k], m_.low[k]);
      if (heeds(L::kHigh + k)) high[k] = std::min(high[k], m_.high[k]);
    }
  }

  Verdict judge(int group, const Vec3& center, const Vec3& half, double, const Patch& patch, const Data&,
                BoundList& out) const {
    const Domain d{half, &patch};
    if (group < m_.arms) return judge_chain(group, center, d, out);
    if (group == m_.arms) return judge_coordinates(center, d, out);
    if (group == m_.arms + 1) return judge_mode(center, d, out);
    return judge_pair(pairs_[static_cast<std::size_t>(group - m_.arms - 2)], center, d, out);
  }

 private:
  static constexpr bool kArms = std::is_same_v<M, machine::RotaryDelta>;
  static constexpr double kScale = 10;  // no term of a limit is larger, in m or m^2
  enum class Other { rod, arm, base };
  struct Pair {
    Other other;
    int i, j, bit;
  };
  using Vector = std::array<FirstOrder, 3>;

  /// A chain over the cell. Arms: along (r, h) of KOZ's circles; rails: along the rail.
  struct Chain {
    Verdict reach = Verdict::inside;
    Vector y;                 ///< from base joint or start of the rail to the platform joint
    FirstOrder y2;            ///< |y|^2
    FirstOrder sine, cosine;  ///< arms: of theta, times a positive number
    FirstOrder slide, under;  ///< rails: q and sqrt(c^2 - across^2)
    Vector end;               ///< S in M
    Vector rod;               ///< platform joint less S
  };

  [[nodiscard]] bool heeds(int limit) const { return (mask_ >> limit & 1U) != 0; }
  [[nodiscard]] Vec3 start(int i) const {
    if constexpr (kArms) {
      return m_.base_joint[i];
    } else {
      return m_.rail_start[i];
    }
  }

  static Linear linear_of(const FirstOrder& f) {
    return {f.value, Vec3(f.gradient[0], f.gradient[1], f.gradient[2]), 0, 0, f.rest, f.rest};
  }
  static Verdict judged(const FirstOrder& f, int limit, const Domain& d, BoundList& out) {
    if (!std::isfinite(f.radius(d))) return Verdict::open;
    return weigh(linear_of(f), limit, kScale, d.half, *d.patch, out);
  }
  static FirstOrder dot(const Vec3& n, const Vector& v) { return n[0] * v[0] + n[1] * v[1] + n[2] * v[2]; }

  /// The chain on its first root; `reach` says whether the rod reaches, its bounds go to `out`.
  [[nodiscard]] Chain chain(int i, const Vec3& center, const Domain& d, BoundList& out) const {
    Chain c;
    const Vec3 y = center + m_.platform_joint[i] - m_.tool - start(i);
    for (std::size_t k = 0; k < 3; ++k) {
      c.y[k].value = y[static_cast<Eigen::Index>(k)];
      c.y[k].gradient[k] = 1;
    }
    c.y2 = square(c.y[0], d) + square(c.y[1], d) + square(c.y[2], d);
    const double l2 = m_.rod_length[i] * m_.rod_length[i];
    const FirstOrder aside = dot(m_.axis[i], c.y);
    if constexpr (kArms) {
      const double arm2 = m_.arm_length[i] * m_.arm_length[i];
      const FirstOrder r = dot(m_.outward[i], c.y), &h = c.y[2];
      const FirstOrder D2 = square(r, d) + square(h, d), alpha = 0.5 * (c.y2 + (arm2 - l2));
      const FirstOrder beta2 = arm2 * D2 - square(alpha, d);
      c.reach = judged((1 / arm2) * beta2, 64 + i, d, out);
      if (c.reach == Verdict::outside || c.reach == Verdict::dead) return c;
      if (singular_ > 0) {  // beta / D, half the distance of the two elbows
        c.reach = both(c.reach, judged((1 / arm2) * (beta2 - (0.25 * singular_ * singular_) * D2), 200 + i, d, out));
        if (c.reach == Verdict::outside || c.reach == Verdict::dead) return c;
      }
      const FirstOrder beta = root(beta2, d);
      c.sine = times(alpha, r, d) + times(beta, h, d);
      const FirstOrder down = times(alpha, h, d) - times(beta, r, d);
      c.cosine = (-1.0) * down;
      const FirstOrder over = inverse_of_positive(D2, d);
      const FirstOrder E_r = times(c.sine, over, d), E_h = times(down, over, d);
      const FirstOrder to_r = r - E_r;
      for (std::size_t k = 0; k < 2; ++k) {
        const auto at = static_cast<Eigen::Index>(k);
        c.rod[k] = m_.outward[i][at] * to_r + m_.axis[i][at] * aside;
      }
      c.rod[2] = h - E_h;
    } else {
      const Vec3& u = m_.rail_direction[i];
      const FirstOrder along = dot(u, c.y);
      const FirstOrder under2 = square(along, d) - (c.y2 - l2);
      c.reach = judged(under2, 64 + i, d, out);
      if (c.reach == Verdict::outside || c.reach == Verdict::dead) return c;
      if (singular_ > 0) {
        c.reach = both(c.reach, judged(under2 - 0.25 * singular_ * singular_, 200 + i, d, out));
        if (c.reach == Verdict::outside || c.reach == Verdict::dead) return c;
      }
      c.under = root(under2, d);
      c.slide = along - c.under;
      for (std::size_t k = 0; k < 3; ++k) c.rod[k] = c.y[k] - u[static_cast<Eigen::Index>(k)] * c.slide;
    }
    for (std::size_t k = 0; k < 3; ++k) c.end[k] = c.y[k] - c.rod[k] + start(i)[static_cast<Eigen::Index>(k)];
    return c;
  }

  Verdict judge_chain(int i, const Vec3& center, const Domain& d, BoundList& out) const {
    const Chain c = chain(i, center, d, out);
    Verdict verdict = c.reach;
    const auto decided = [&] { return verdict == Verdict::outside || verdict == Verdict::dead; };
    const auto add = [&](const FirstOrder& f, int limit) {
      if (!decided() && heeds(limit % 64)) verdict = both(verdict, judged(f, limit, d, out));
    };
    if (decided()) return verdict;
    const machine::RodJoint& joint = m_.joint;
    const double l = m_.rod_length[i];
    if (joint.side < std::numbers::pi / 2) {
      const FirstOrder aside = dot(m_.axis[i], c.y);
      const double most = l * std::sin(joint.side);
      add(FirstOrder(most) - aside, L::kSide + i);
      add(aside + most, 128 + L::kSide + i);
    }
    FirstOrder along = c.under;  // rod . arm
    if constexpr (kArms) {
      const double arm = m_.arm_length[i];
      along = (0.5 / arm) * (c.y2 - (arm * arm + l * l));
      verdict = both(verdict, judge_angle(i, c, d, out));
    } else {
      add(c.slide, L::kMin + i);
      add(FirstOrder(m_.range.max) - c.slide, L::kMax + i);
    }
    if (joint.elbow_min > 0) add(FirstOrder(l * std::cos(joint.elbow_min)) - along, L::kElbow + i);
    if (joint.elbow_max < std::numbers::pi) add(along - l * std::cos(joint.elbow_max), 128 + L::kElbow + i);
    if (joint.platform < std::numbers::pi) add(c.rod[2] - l * std::cos(joint.platform), L::kPlatform + i);
    if (singular_ > 0 && !decided()) verdict = both(verdict, judged(c.rod[2] - singular_, 204 + i, d, out));
    if (m_.bodies.table_z) {
      const double table = *m_.bodies.table_z - 0.5 * m_.bodies.rod_diameter;
      add(FirstOrder(table) - c.end[2], L::kTable + i);
      add(FirstOrder(table) - c.end[2] - c.rod[2], 128 + L::kTable + i);
    }
    return verdict;
  }

  /// theta between two ends: the common part of two half planes up to half a turn, their union beyond.
  Verdict judge_angle(int i, const Chain& c, const Domain& d, BoundList& out) const {
    const double width = m_.range.max - m_.range.min;
    if (width >= 2 * std::numbers::pi - 1e-9) return Verdict::inside;
    if constexpr (kArms) {
      const double low = m_.range.min + m_.zero[i], high = m_.range.max + m_.zero[i];
      const FirstOrder from_low = std::cos(low) * c.sine - std::sin(low) * c.cosine;
      const FirstOrder to_high = std::sin(high) * c.cosine - std::cos(high) * c.sine;
      const bool common = width <= std::numbers::pi;
      if (!heeds(L::kMin + i) || !heeds(L::kMax + i)) {
        if (heeds(L::kMin + i) == heeds(L::kMax + i) || !common) return Verdict::inside;
        return heeds(L::kMin + i) ? judged(from_low, L::kMin + i, d, out) : judged(to_high, L::kMax + i, d, out);
      }
      if (common) {
        const Verdict above = judged(from_low, L::kMin + i, d, out);
        return both(above, judged(to_high, L::kMax + i, d, out));
      }
      BoundList above, below;
      const Verdict keeps_low = judged(from_low, L::kMin + i, d, above);
      const Verdict keeps_high = judged(to_high, L::kMax + i, d, below);
      if (keeps_low == Verdict::inside || keeps_high == Verdict::inside) return Verdict::inside;
      const auto broken = [](Verdict v) { return v == Verdict::outside || v == Verdict::dead; };
      if (broken(keeps_low)) {
        out.append(below);
        return keeps_high;
      }
      if (broken(keeps_high)) {
        out.append(above);
        return keeps_low;
      }
      return Verdict::open;
    }
    return Verdict::inside;
  }

  Verdict judge_coordinates(const Vec3& center, const Domain& d, BoundList& out) const {
    Verdict verdict = Verdict::inside;
    for (int k = 0; k < 3; ++k) {
      FirstOrder x(center[k]);
      x.gradient[static_cast<std::size_t>(k)] = 1;
      if (heeds(L::kLow + k) && std::isfinite(m_.low[k])) {
        verdict = both(verdict, judged(x - m_.low[k], L::kLow + k, d, out));
      }
      if (heeds(L::kHigh + k) && std::isfinite(m_.high[k])) {
        verdict = both(verdict, judged(FirstOrder(m_.high[k]) - x, L::kHigh + k, d, out));
      }
    }
    return verdict;
  }

  /// det(y_1, y_2, y_3) of the three rods; over |n|, n = (y_1 - y_2) x (y_1 - y_3), half the distance of the two poses.
  Verdict judge_mode(const Vec3& center, const Domain& d, BoundList& out) const {
    if (!heeds(L::kMode) && !(singular_ > 0)) return Verdict::inside;
    std::array<Vector, 3> rod;
    BoundList unused;
    for (int i = 0; i < 3; ++i) {
      const Chain c = chain(i, center, d, unused);
      if (c.reach == Verdict::outside || c.reach == Verdict::dead) return c.reach;
      rod[static_cast<std::size_t>(i)] = c.rod;
    }
    FirstOrder volume;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t a = (k + 1) % 3, b = (k + 2) % 3;
      volume = volume + times(rod[0][k], times(rod[1][a], rod[2][b], d) - times(rod[1][b], rod[2][a], d), d);
    }
    const double scale = 1 / (m_.rod_length[0] * m_.rod_length[0]);
    volume = m_.mode_sign * scale * volume;
    Verdict verdict = heeds(L::kMode) ? judged(volume, L::kMode, d, out) : Verdict::inside;
    if (!(singular_ > 0)) return verdict;
    Vector e, f;
    FirstOrder n2;
    for (std::size_t k = 0; k < 3; ++k) {
      e[k] = rod[0][k] - rod[1][k];
      f[k] = rod[0][k] - rod[2][k];
    }
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t a = (k + 1) % 3, b = (k + 2) % 3;
      n2 = n2 + square(times(e[a], f[b], d) - times(e[b], f[a], d), d);
    }
    return both(verdict, judged(volume - 0.5 * singular_ * scale * root(n2, d), 208, d, out));
  }

  Verdict judge_pair(const Pair& pair, const Vec3& center, const Domain& d, BoundList& out) const {
    BoundList unused;
    const Chain one = chain(pair.i, center, d, unused);
    if (one.reach == Verdict::outside || one.reach == Verdict::dead) return one.reach;
    const machine::DeltaBodies& bodies = m_.bodies;
    Vector from, to;  // of the other body
    const auto fixed = [](Vector& v, const Vec3& p) {
      for (std::size_t k = 0; k < 3; ++k) v[k] = FirstOrder(p[static_cast<Eigen::Index>(k)]);
    };
    const int rods = machine::delta_detail::rods_of(m_);
    if (pair.other == Other::base) {
      Verdict verdict = Verdict::inside;
      for (int edge = 0; edge < m_.arms; ++edge) {
        fixed(from, start(edge));
        fixed(to, start((edge + 1) % m_.arms));
        verdict = both(verdict, apart_from_rods(pair, edge, 0.5 * (bodies.rod_diameter + bodies.base_thickness), one,
                                                from, to, 1, d, out));
      }
      return verdict;
    }
    const Chain other = chain(pair.j, center, d, unused);
    if (other.reach == Verdict::outside || other.reach == Verdict::dead) return other.reach;
    if (pair.other == Other::rod) {
      from = to = other.end;
      for (std::size_t k = 0; k < 3; ++k) to[k] = to[k] + other.rod[k];
      return apart_from_rods(pair, 0, bodies.rod_diameter, one, from, to, rods, d, out);
    }
    fixed(from, start(pair.j));
    if constexpr (kArms) {
      to = other.end;
    } else {
      fixed(to, start(pair.j) + m_.range.max * m_.rail_direction[pair.j]);
    }
    return apart_from_rods(pair, 0, 0.5 * (bodies.rod_diameter + bodies.arm_diameter), one, from, to, 1, d, out);
  }

  /// The rods of chain `one` against the segment from..to, or against `others` rods about it.
  Verdict apart_from_rods(const Pair& pair, int edge, double thickness, const Chain& one, const Vector& from,
                          const Vector& to, int others, const Domain& d, BoundList& out) const {
    const int rods = machine::delta_detail::rods_of(m_);
    const auto shift = [&](int count, int which, int i) {
      return count < 2 ? Vec3(Vec3::Zero())
                       : Vec3(machine::delta_detail::rod_offsets(m_)[static_cast<std::size_t>(which)] * m_.axis[i]);
    };
    Verdict verdict = Verdict::inside;
    for (int a = 0; a < rods; ++a)
      for (int b = 0; b < others; ++b) {
        const int limit = 10000 * (1 + 4 * edge + 2 * a + b) + pair.bit;
        verdict = both(
            verdict, apart(limit, thickness, one, shift(rods, a, pair.i), from, to, shift(others, b, pair.j), d, out));
        if (verdict == Verdict::outside || verdict == Verdict::dead) return verdict;
      }
    return verdict;
  }

  /// The rod from c.end along c.rod, shifted, against the segment from..to.
  static Verdict apart(int limit, double thickness, const Chain& c, const Vec3& shift_i, const Vector& from,
                       const Vector& to, const Vec3& shift_j, const Domain& d, BoundList& out) {
    const auto value = [](const Vector& v) { return Vec3(v[0].value, v[1].value, v[2].value); };
    const auto moved = [&](const Vector& v) { return Vec3(v[0].radius(d), v[1].radius(d), v[2].radius(d)).norm(); };
    // P - Q of the points at s of the rod and t of the other segment.
    const auto between = [&](double s, double t) {
      Vector v;
      for (std::size_t k = 0; k < 3; ++k) v[k] = c.end[k] + s * c.rod[k] - (1 - t) * from[k] - t * to[k];
      return v;
    };
    if (!std::isfinite(moved(between(0.5, 0.5)))) return Verdict::open;
    const Vec3 end = value(c.end) + shift_i;
    const std::array<Vec3, 4> ends{end, end + value(c.rod), value(from) + shift_j, value(to) + shift_j};
    const auto point = [&](const Vec3& n, double s, double t) {
      return linear_of(dot(n, between(s, t)) + n.dot(shift_i - shift_j));
    };
    const auto way = [&](double s, double t) { return moved(between(s, t)); };
    return weigh_pair(limit, thickness, ends, point, way, d.half, *d.patch, out);
  }

  const M& m_;
  LimitBits mask_;
  double singular_;  ///< m, Options::singular_distance
  std::vector<Pair> pairs_;
};

/// What volume() asks over boxes.
template <machine::DeltaFamily M>
Result<DeltaBounds<M>> bounds_of(const M& m, const Options& options) {
  return DeltaBounds<M>(m, options);
}

}  // namespace polypod::workspace
