// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The joint limits of an arm with one freedom more than its task holds, over boxes of tool positions and patches of
// orientations.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "limit_terms.hpp"

namespace polypod::workspace {

/// What RedundantInverse calls u: the place of a rail or a turntable that carries the arm, or the turn about the tool
/// axis. From it the arm sees a pose that its own inverse serves.
struct OneMore {
  enum class Kind : std::uint8_t { rail, turntable, spin };
  Kind kind = Kind::spin;
  Vec3 axis = Vec3::UnitZ();  ///< rail: the way of the arm for u = 1; turntable: of the turn, both in M
  Vec3 point = Vec3::Zero();  ///< turntable: on the axis
  double from = 0, to = 0;

  /// What the arm sees of a box and a patch from all u within w / 2 of the one that is asked for.
  struct Seen {
    Vec3 center, half;
    Patch patch;
    Mat3 turn = Mat3::Identity();  ///< x in the box is seen at turn x ...
    Vec3 along = Vec3::Zero();     ///< ... but for so much either way along this line ...
    double round = 0;              ///< ... or so much in any direction
  };
  [[nodiscard]] Seen seen(const Vec3& center, const Vec3& half, const Patch& patch, double u, double w) const {
    Seen out{center, half, patch};
    if (kind == Kind::rail) {
      out.center = center - u * axis;
      out.along = 0.5 * w * axis;
      out.half += out.along.cwiseAbs();
      return out;
    }
    // |R(a) - 1| <= |a| for a turn by a.
    out.patch.bend += 0.5 * w;
    if (kind == Kind::spin) {
      out.patch.R = patch.R * rotation_z(u);
      return out;
    }
    out.turn = Eigen::AngleAxisd(-u, axis).toRotationMatrix();
    const Vec3 arm = out.turn * (center - point);
    out.center = point + arm;
    out.patch.R = out.turn * patch.R;
    out.patch.omega1 = out.turn * patch.omega1;
    out.patch.omega2 = out.turn * patch.omega2;
    out.along = 0.5 * w * axis.cross(arm);
    // What the arc leaves its tangent by, and the turn of the box itself.
    out.round = 0.125 * w * w * arm.norm() + 0.5 * w * half.norm();
    out.half = out.turn.cwiseAbs() * half + out.along.cwiseAbs() + Vec3::Constant(out.round);
    return out;
  }
};

/// A pose is reached where the arm reaches what it sees of it from some u. `Inner` judges the arm. From a piece of the
/// range of u the arm sees a larger box and patch: what it misses for all of them, it does not reach from there; what
/// it reaches from one u is reached. Pieces are halved until they make the box no more than a share larger.
///
/// Bounds: the part of a box that is reached is at least that from the best u that was looked at, and at most what the
/// pieces together reach, one plane above all of theirs.
template <class Inner>
class OneMoreLimits {
 public:
  struct Data {};

  /// `tolerance`: to which the volume is asked for.
  OneMoreLimits(Inner arm, const OneMore& more, double tolerance)
      : arm_(std::move(arm)), more_(more), tolerance_(tolerance) {
    arm_.box(low_, high_, Directions{});
  }

  [[nodiscard]] static int groups() { return 1; }
  /// What takes ten seconds, where that may do: a rail brings some 5 % by then, a turn about the tool axis,
  /// which converges with the first order of the box, some 20 %, a turntable some 50 %.
  [[nodiscard]] std::int64_t few_boxes() const {
    const bool rail = more_.kind == OneMore::Kind::rail;
    constexpr double kOfRail = 0.05, kOfTurn = 0.2;
    if (tolerance_ < (rail ? kOfRail : kOfTurn)) return 3'000;
    return rail ? 150'000 : 20'000;
  }
  /// Of a cone there is no plane above what the pieces reach: no number of boxes would do.
  [[nodiscard]] static std::int64_t few_boxes_of_a_cone() { return 64; }
  /// What takes some seconds.
  [[nodiscard]] std::int64_t boxes_of_sides() const { return more_.kind == OneMore::Kind::rail ? 20'000 : 3'000; }
  [[nodiscard]] double lever() const { return arm_.lever(); }
  /// The rail, whose limits are the first two.
  [[nodiscard]] LimitBits ends() const { return more_.kind == OneMore::Kind::rail ? 3 : 0; }
  void box(Vec3& low, Vec3& high, const Directions&) const {
    low = low_;
    high = high_;
    if (more_.kind == OneMore::Kind::rail) {
      low += (more_.from * more_.axis).cwiseMin(more_.to * more_.axis);
      high += (more_.from * more_.axis).cwiseMax(more_.to * more_.axis);
    } else if (more_.kind == OneMore::Kind::turntable) {
      const Vec3 middle = 0.5 * (low_ + high_);
      const double radius = more_.axis.cross(middle - more_.point).norm() + 0.5 * (high_ - low_).norm();
      const Vec3 foot = more_.point + more_.axis * more_.axis.dot(middle - more_.point);
      low = foot - Vec3::Constant(radius);
      high = foot + Vec3::Constant(radius);
    }
  }
  [[nodiscard]] static std::size_t bytes(const Data&) { return 0; }
  [[nodiscard]] static Data prepare(const Patch&) { return {}; }

  Verdict judge(int, const Vec3& center, const Vec3& half, double radius, const Patch& patch, const Data&,
                BoundList& out) const {
    double a = more_.from, b = more_.to;
    if (!meets(center, half, a, b)) return Verdict::dead;
    Look look{*this, center, half, patch};
    const double finest = kFinest * radius / per_u(center);
    std::vector<Piece> now{{a, b}}, next;
    for (int level = 0; !now.empty(); ++level) {
      next.clear();
      for (const Piece& p : now) {
        const bool last = !(p.length() > finest);
        if ((last || level < kFewLevels) && look.reaches_from(p.middle())) return Verdict::inside;
        switch (look.over(p, last)) {
          case Verdict::inside:
            return Verdict::inside;
          case Verdict::dead:
            continue;
          default:
            break;
        }
        if (last) continue;
        next.push_back({p.from, p.middle()});
        next.push_back({p.middle(), p.to});
      }
      now.swap(next);
    }
    if (look.bounded && look.above.empty()) return Verdict::dead;
    for (const double end : {a, b})  // which are the middle of no piece
      if (look.reaches_from(end)) return Verdict::inside;
    bool any = false;
    if (look.most > -kInfinity) {
      for (Bound bound : look.best) {
        bound.M = kInfinity;
        any = out.push_back(bound) || any;
      }
    } else {
      any = out.push_back({kNothing, -kInfinity, kInfinity, Vec3::Zero()});
    }
    if (look.bounded) any = out.push_back(plane_above(look.above, half)) || any;
    return any ? Verdict::undecided : Verdict::open;
  }

 private:
  struct Piece {
    double from, to;
    [[nodiscard]] double middle() const { return 0.5 * (from + to); }
    [[nodiscard]] double length() const { return to - from; }
  };
  static constexpr double kInfinity = arm::kInfinity;
  static constexpr double kFinest = 1;              // of a box's radius
  static constexpr double kLeastHand = 0.05;        // m
  static constexpr int kFewLevels = 4;              // in which most boxes within are found
  static constexpr int kNothing = 20, kAbove = 21;  // beyond the labels of the arm's limits

  /// What was seen of one box and patch.
  struct Look {
    const OneMoreLimits& of;
    const Vec3 &center, &half;
    const Patch& patch;
    BoundList best = {}, bounds = {};
    double most = -kInfinity;       ///< what `best` keeps
    std::vector<Bound> above = {};  ///< one a piece
    bool bounded = true;            ///< there is one for every piece

    Verdict judge(const OneMore::Seen& seen) {
      bounds.clear();
      return of.arm_.judge(0, seen.center, seen.half, seen.half.norm(), seen.patch, of.arm_.prepare(seen.patch),
                           bounds);
    }
    /// Whether the arm reaches all from u; else what it reaches from there may be the most so far.
    bool reaches_from(double u) {
      const OneMore::Seen seen = of.more_.seen(center, half, patch, u, 0);
      const Verdict v = judge(seen);
      if (v == Verdict::inside) return true;
      if (v != Verdict::undecided) return false;
      if (const double least = arm::least_of(bounds); least > most) {
        most = least;
        best.clear();
        for (Bound bound : bounds) {
          bound.G = seen.turn.transpose() * bound.G;
          best.push_back(bound);
        }
      }
      return false;
    }
    /// inside: all is reached from each u of the piece; dead: nothing from any. Where it is `last`, a plane above what
    /// the piece reaches is added.
    Verdict over(const Piece& p, bool last) {
      const OneMore::Seen seen = of.more_.seen(center, half, patch, p.middle(), p.length());
      const Verdict v = judge(seen);
      // Of one direction what fails for some fails for all.
      const bool one = patch.turn == 0;
      if (v == Verdict::inside || v == Verdict::dead) return v;
      if (one && v == Verdict::outside) return Verdict::dead;
      if (last) bounded = bounded && one && v == Verdict::undecided && add_above(seen);
      return Verdict::undecided;
    }
    bool add_above(const OneMore::Seen& seen) {
      const Bound* least = nullptr;
      double lowest = kInfinity;
      for (const Bound& bound : bounds) {
        const double size = bound.G.norm();
        if (!std::isfinite(bound.M) || !(size > 0)) continue;
        const double at = (bound.M + std::abs(bound.G.dot(seen.along))) / size + seen.round;
        if (at < lowest) least = &bound;
        lowest = std::min(lowest, at);
      }
      if (least == nullptr) return false;
      above.push_back({kAbove, kInfinity, lowest, seen.turn.transpose() * least->G.normalized()});
      return true;
    }
  };

  /// How far u = 1 moves what the arm sees, m.
  [[nodiscard]] double per_u(const Vec3& center) const {
    if (more_.kind == OneMore::Kind::rail) return more_.axis.norm();
    const double away = more_.kind == OneMore::Kind::spin ? 0.0 : more_.axis.cross(center - more_.point).norm();
    return std::max(away + arm_.hand(), kLeastHand);
  }

  /// The places of a rail from which the box that holds the arm's workspace meets this one; false: none.
  bool meets(const Vec3& center, const Vec3& half, double& a, double& b) const {
    if (more_.kind != OneMore::Kind::rail) return true;
    for (int i = 0; i < 3; ++i) {
      // low <= center +- half - u axis <= high for some tip.
      const double least = center[i] - half[i] - high_[i], largest = center[i] + half[i] - low_[i];
      const double e = more_.axis[i];
      if (std::abs(e) < 1e-9) {
        if (least > kSlack || largest < -kSlack) return false;
        continue;
      }
      a = std::max(a, std::min(least / e, largest / e));
      b = std::min(b, std::max(least / e, largest / e));
    }
    return a <= b;
  }
  static constexpr double kSlack = 1e-6;  // m, what an axis below 1e-9 shifts by

  /// One above all of them, all over the box.
  static Bound plane_above(const std::vector<Bound>& above, const Vec3& half) {
    Bound out = *std::max_element(above.begin(), above.end(), [](const Bound& a, const Bound& b) { return a.M < b.M; });
    const Vec3 G = out.G;
    for (const Bound& b : above) out.M = std::max(out.M, b.M + (b.G - G).cwiseAbs().dot(half));
    return out;
  }

  Inner arm_;
  OneMore more_;
  double tolerance_;
  Vec3 low_, high_;  ///< hold the arm's workspace
};

}  // namespace polypod::workspace
