// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The limits of one branch of an arm's closed inverse over a cell and a patch, put together.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "../../workspace/first_order.hpp"
#include "../../workspace/linear.hpp"
#include "polypod/machine/common.hpp"

namespace polypod::workspace::arm {

inline constexpr double kInfinity = std::numeric_limits<double>::infinity();
inline constexpr double kHalfTurn = std::numbers::pi;
inline constexpr double kTurn = 2 * std::numbers::pi;
inline constexpr double kScale = 10;  // no term of a limit is larger, in m, m^2 or as a sine
inline constexpr double kSlack = kRounding * kScale;

/// Conditions that all must hold, and what is known of them.
struct Terms {
  Verdict verdict = Verdict::inside;
  BoundList bounds;
  void append(const Terms& other) {
    verdict = both(verdict, other.verdict);
    bounds.append(other.bounds);
  }
};

/// f >= 0 as one more of them.
inline void add(const FirstOrder& f, int limit, const Domain& d, Terms& terms) {
  Verdict verdict = Verdict::open;
  if (std::isfinite(f.radius(d))) {
    const Linear linear{
        f.value, Vec3(f.gradient[0], f.gradient[1], f.gradient[2]), f.gradient[3], f.gradient[4], f.rest, f.rest};
    verdict = weigh(linear, limit, kScale, d.half, *d.patch, terms.bounds);
  }
  terms.verdict = both(terms.verdict, verdict);
}

/// Both of two conditions are enough, but it is not known which of them counts: their bounds from below.
inline void below_only(const Terms& enough, int limit, Terms& terms) {
  terms.verdict = both(terms.verdict, Verdict::undecided);
  if (enough.verdict == Verdict::inside) return;
  if (enough.verdict != Verdict::undecided) {
    terms.bounds.push_back({limit, -kInfinity, kInfinity, Vec3::Zero()});
    return;
  }
  for (Bound bound : enough.bounds) {
    bound.M = kInfinity;
    terms.bounds.push_back(bound);
  }
}

/// How much is certainly kept at the middle of the cell, for a choice.
inline double least_of(const BoundList& bounds) {
  double least = kInfinity;
  for (const Bound& b : bounds) least = std::min(least, b.m / b.G.norm());
  return least;
}

/// One of two conditions: where both are possible, the one that keeps more is a bound from below.
inline void either(const Terms& a, const Terms& b, int limit, Terms& terms) {
  if (a.verdict == Verdict::inside || b.verdict == Verdict::inside) return;
  if (a.verdict == Verdict::dead) return terms.append(b);
  if (b.verdict == Verdict::dead) return terms.append(a);
  const bool first =
      a.verdict == Verdict::undecided && (b.verdict != Verdict::undecided || least_of(a.bounds) > least_of(b.bounds));
  below_only(first ? a : b, limit, terms);
}

/// The branch of an inverse that is one more way to keep all limits. `possible` is what the others say, dead at first.
inline void or_else(const Terms& branch, Terms& possible) {
  if (branch.verdict == Verdict::dead) return;
  if (possible.verdict == Verdict::dead) {  // the only possible branch so far
    possible = branch;
    return;
  }
  Terms some;
  either(possible, branch, 0, some);
  possible = some;
}

/// Whether any angle is some turn within the range of a joint, or one of its ends may be passed.
inline bool turns_freely(double low, double high, LimitBits heeded, std::size_t joint) {
  return high - low >= kTurn - 1e-9 || (heeded >> (2 * joint) & 3U) != 3;
}

/// The angle of a vector (x, y) of any length within a range. A range of up to half a turn is the common part of two
/// half planes, a longer one their union.
struct Turn {
  bool free = true, common = false;
  double cos_low = 1, sin_low = 0, cos_high = 1, sin_high = 0;

  Turn() = default;
  /// `free`: any angle is some turn within the range, or its ends may be passed.
  Turn(double low, double high, bool is_free)
      : free(is_free),
        common(high - low <= kHalfTurn),
        cos_low(std::cos(low)),
        sin_low(std::sin(low)),
        cos_high(std::cos(high)),
        sin_high(std::sin(high)) {}
};
/// `limit` is the lower end of the range, limit + 1 the upper one.
inline void keep_turn(const Turn& range, int limit, const FirstOrder& x, const FirstOrder& y, const Domain& d,
                      Terms& terms) {
  if (range.free) return;
  const FirstOrder from_low = range.cos_low * y - range.sin_low * x, to_high = range.sin_high * x - range.cos_high * y;
  if (range.common) {
    add(from_low, limit, d, terms);
    add(to_high, limit + 1, d, terms);
    return;
  }
  Terms above, below;
  add(from_low, limit, d, above);
  add(to_high, limit + 1, d, below);
  either(above, below, limit, terms);
}

/// The angles t in 0 to 180 deg with offset + sense t in a joint's range, as a range of their cosines.
struct HalfTurn {
  Verdict verdict = Verdict::undecided;  ///< dead: none; open: more than one stretch of them
  bool from = false, to = false;         ///< whether there is something to keep
  double cosine_from = -1, cosine_to = 1;
};
/// `free`: any angle is some turn within the range, or its ends may be passed.
inline HalfTurn half_turn_of(const machine::JointRange& range, bool free, double offset, double sense) {
  HalfTurn out;
  double low = 0, high = kHalfTurn;
  if (!free) {
    std::vector<std::array<double, 2>> parts;
    for (int k = -3; k <= 3; ++k) {
      const double at_min = sense * (range.min - offset) + k * kTurn, at_max = sense * (range.max - offset) + k * kTurn;
      const double from = std::max(0.0, std::min(at_min, at_max)), to = std::min(kHalfTurn, std::max(at_min, at_max));
      if (from <= to) parts.push_back({from, to});
    }
    if (parts.empty()) {
      out.verdict = Verdict::dead;
      return out;
    }
    if (parts.size() > 1) {
      out.verdict = Verdict::open;
      return out;
    }
    low = parts[0][0];
    high = parts[0][1];
  }
  out.from = high < kHalfTurn;
  out.to = low > 0;
  out.cosine_from = std::cos(high);
  out.cosine_to = std::cos(low);
  return out;
}
inline void keep_within(const HalfTurn& range, int limit, const FirstOrder& cosine, const Domain& d, Terms& terms) {
  if (range.verdict != Verdict::undecided) {
    terms.verdict = both(terms.verdict, range.verdict);
    return;
  }
  if (range.from) add(cosine - range.cosine_from, limit, d, terms);
  if (range.to) add(FirstOrder(range.cosine_to) - cosine, limit + 1, d, terms);
}

/// f, of which it is known that |f| <= most.
inline FirstOrder at_most(const FirstOrder& f, double most, const Domain& d) {
  if (f.radius(d) <= most) return f;
  FirstOrder out;
  out.rest = most;
  return out;
}

/// R_AM R b over a patch of the orientations R.
inline std::array<FirstOrder, 3> turned(const Mat3& R_AM, const Patch& patch, const Vec3& b_T) {
  const Vec3 b = patch.R * b_T;
  const Vec3 value = R_AM * b, by1 = R_AM * patch.omega1.cross(b), by2 = R_AM * patch.omega2.cross(b);
  std::array<FirstOrder, 3> out;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto at = static_cast<Eigen::Index>(i);
    out[i].value = value[at];
    out[i].gradient = {0, 0, 0, by1[at], by2[at]};
    out[i].rest = patch.bend * b_T.norm();
  }
  return out;
}
/// from_tip, seen from the tips round `center` in M.
inline std::array<FirstOrder, 3> moved(std::array<FirstOrder, 3> from_tip, const Mat3& R_AM, const Vec3& p_AM,
                                       const Vec3& center) {
  const Vec3 p = R_AM * center + p_AM;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto at = static_cast<Eigen::Index>(i);
    from_tip[i].value += p[at];
    for (std::size_t k = 0; k < 3; ++k) from_tip[i].gradient[k] = R_AM(at, static_cast<Eigen::Index>(k));
  }
  return from_tip;
}

}  // namespace polypod::workspace::arm
