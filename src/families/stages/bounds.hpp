// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The limits of a wrist on a module of legs over boxes of its tip's position and patches of orientations.
#pragma once

#include <memory>

#include "../../workspace/no_bounds.hpp"
#include "../parallel/bounds.hpp"
#include "polypod/families/stages/kinematics.hpp"
#include "wrist_on_module.hpp"

namespace polypod::workspace {

/// What WristLimits is made of before the limits of the module.
struct WristHeld {
  std::shared_ptr<const machine::WristOnModule> form;
};

/// The module is judged as one with its tool tip at the wrist's centre, where box and patch put that; then, with its
/// orientation in first order, the wrist: of both its postures one must keep the ranges of joints 1 and 2. Joint 3
/// turns all the way round (bounded()).
class WristLimits : private WristHeld, public ParallelLimits {
 public:
  WristLimits(const machine::Stages& m, std::shared_ptr<const machine::WristOnModule> wrist, const Options& options)
      : WristHeld{std::move(wrist)},
        ParallelLimits(*form->placing(), options, Carrying{m.data[0].mount.inverse(), form->centre_in_tool()}),
        stages_(m),
        module_tip_(std::get<machine::Parallel>(m.machines[0])),
        first_of_wrist_(static_cast<int>(kinematics::limit_table(m.machines[0]).size())) {
    for (int i = 0; i < m.data[1].joints; ++i) ranges_.push_back(kinematics::joint_range(m.machines[1], i));
  }

  [[nodiscard]] static int groups() { return 1; }
  [[nodiscard]] double lever() const { return std::max(ParallelLimits::lever(), form->centre_in_tool().norm()); }
  /// Boxes where the wrist is straight stay undecided where joint 1 has an end.
  [[nodiscard]] static std::int64_t few_boxes() { return 400'000; }

  void box(Vec3& low, Vec3& high, const Directions& directions) const {
    Vec3 a, b;
    ParallelLimits::box(a, b, directions);
    for (int k = 0; k < 3; ++k) {
      if (heeds(2 * joint_count(m_) + k)) a[k] = std::max(a[k], module_tip_.low[k] - off());
      if (heeds(2 * joint_count(m_) + 3 + k)) b[k] = std::min(b[k], module_tip_.high[k] + off());
    }
    const Pose& mount = stages_.data[0].mount;
    const Vec3 middle = mount * Vec3(0.5 * (a + b)), half = mount.R.cwiseAbs() * Vec3(0.5 * (b - a));
    const Vec3 reach = half + Vec3::Constant(form->centre_in_tool().norm() * (1 + kRounding));
    low = middle - reach;
    high = middle + reach;
    const int tip = first_of_tip();
    for (int k = 0; k < 3; ++k) {
      if (heeds(tip + k)) low[k] = std::max(low[k], stages_.low[k]);
      if (heeds(tip + 3 + k)) high[k] = std::min(high[k], stages_.high[k]);
    }
  }

  Verdict judge(int, const Vec3& center, const Vec3& half, double, const Patch& patch, const Data&,
                BoundList& out) const {
    const Domain d{half, &patch};
    Verdict verdict = tip_within(stages_, first_of_tip(), position(center, d), d, out);
    if (verdict == Verdict::dead) {
      out.clear();
      return verdict;
    }
    const bool out_of_module = module_tip_is_out(center, d);
    const std::optional<PoseT<N>> X = out_of_module ? std::nullopt : pose_over(center, d);
    if (!X) {
      out.clear();
      return out_of_module || too_far(center, d) ? Verdict::dead : Verdict::open;
    }
    verdict = both(verdict, legs_and_tip(*X, d, out));
    const Vector3<DomainNumber> module = X->p - Vector3<DomainNumber>(X->R * constant(form->centre_in_module()));
    verdict = both(verdict, tip_within(module_tip_, 2 * joint_count(m_), module, d, out));
    if (verdict != Verdict::dead) verdict = both(verdict, wrist(*X, d, out));
    if (verdict != Verdict::undecided) out.clear();
    return verdict;
  }

 private:
  using N = DomainNumber;

  [[nodiscard]] int first_of_tip() const { return first_of_wrist_ + 2 * static_cast<int>(ranges_.size()); }
  [[nodiscard]] bool heeds(int limit) const { return limit >= 64 || (mask_ >> limit & 1U) != 0; }

  [[nodiscard]] int reach_limit() const { return 64 + joint_count(m_); }

  static N dot(const Vec3& a, const Vector3<N>& b) { return N(a[0]) * b[0] + N(a[1]) * b[1] + N(a[2]) * b[2]; }
  static N dot(const Vector3<N>& a, const Vector3<N>& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
  static Vector3<N> cross(const Vec3& a, const Vector3<N>& b) { return skew(a).cast<N>() * b; }

  /// How far the module's own tool tip is from the wrist's centre, m, at most.
  [[nodiscard]] double off() const { return form->centre_in_module().norm() * (1 + kRounding); }

  /// Whether the module's own tool tip is beyond its limits wherever it is about the wrist's centre.
  [[nodiscard]] bool module_tip_is_out(const Vec3& center, const Domain& d) const {
    for (int k = 0; k < 3; ++k) {
      const bool low = heeds(2 * joint_count(m_) + k) && std::isfinite(module_tip_.low[k]),
                 high = heeds(2 * joint_count(m_) + 3 + k) && std::isfinite(module_tip_.high[k]);
      if (!low && !high) continue;
      const N at = placed(k, center, d);
      const double value = at.first_order().value, about = at.radius() + off();
      if ((low && value + about < module_tip_.low[k]) || (high && value - about > module_tip_.high[k])) return true;
    }
    return false;
  }

  Verdict tip_within(const machine::TipLimits& tip, int first, const Vector3<N>& p, const Domain& d,
                     BoundList& out) const {
    Verdict verdict = Verdict::inside;
    for (int k = 0; k < 3; ++k) {
      if (std::isfinite(tip.low[k]))
        verdict = both(verdict, judged(p[k] - N(tip.low[k]), first + k, reach_ + std::abs(tip.low[k]), d, out));
      if (std::isfinite(tip.high[k]))
        verdict = both(verdict, judged(N(tip.high[k]) - p[k], first + 3 + k, reach_ + std::abs(tip.high[k]), d, out));
    }
    return verdict;
  }

  /// Whether a joint of the wrist that is at (cos, sin) = (x, y) / |(x, y)| is within its range.
  Terms in_range(int joint, const N& x, const N& y, const Domain& d) const {
    const machine::JointRange& range = ranges_[static_cast<std::size_t>(joint)];
    const int limit = first_of_wrist_ + 2 * joint;
    if (turns_round(range) || !heeds(limit) || !heeds(limit + 1)) return {};
    return between(x, y, range.min, range.max, limit, 1, d);
  }

  /// WristOnModule's two places of the vector that the wrist turns, in first order.
  Verdict wrist(const PoseT<N>& X, const Domain& d, BoundList& out) const {
    const Vec3 &u1 = form->axes()[0], &u2 = form->axes()[1];
    const bool three = form->axes().size() == 3;
    const Vec3 v = three ? form->axes()[2] : Vec3(form->tool_at_zero().col(2));
    const Vec3 v_in_tool = form->tool_at_zero().transpose() * v;
    const Matrix3<N> R = stages_.data[0].mount.R.cast<N>() * X.R * stages_.data[1].mount.R.cast<N>();
    const Vector3<N> k = R.transpose() * Vector3<N>(patched(d) * constant(v_in_tool));
    const double c = u1.dot(u2);
    const Vec3 aside = (u2 - c * u1).normalized(), n = u1.cross(aside);
    const N along = dot(u1, k);
    const N toward = N(1 / u2.dot(aside)) * (N(u2.dot(v)) - N(c) * along);
    const Vector3<N> across = cross(u1, k);
    const N rest = dot(across, across) - square(toward), beta = sqrt(rest);
    // The rest is not negative where the angle of k to axis 1 is between the difference and the sum of those of axes 1
    // and 2 and of axis 2 and v: in its cosine, for the rest itself is flat where the wrist is straight.
    BoundList reach_bounds;
    Verdict reach = Verdict::inside;
    const double at_2 = std::acos(std::clamp(c, -1.0, 1.0)), of_v = std::acos(std::clamp(u2.dot(v), -1.0, 1.0));
    const double nearest = std::abs(at_2 - of_v), farthest = at_2 + of_v;
    constexpr double kSame = 1e-9;
    if (nearest > kSame) reach = both(reach, judged(N(std::cos(nearest)) - along, reach_limit(), 1, d, reach_bounds));
    if (std::abs(farthest - std::numbers::pi) > kSame) {
      const double end = std::min(farthest, 2 * std::numbers::pi - farthest);
      reach = both(reach, judged(along - N(std::cos(end)), reach_limit(), 1, d, reach_bounds));
    }
    const auto posture = [&](double side) {
      Vector3<N> z;
      for (int i = 0; i < 3; ++i) z[i] = along * N(u1[i]) + toward * N(aside[i]) + N(side * n[i]) * beta;
      const Vec3 from = v - u2.dot(v) * u2;
      Terms terms = in_range(1, dot(from, z), dot(Vec3(u2.cross(from)), z), d);
      Vector3<N> a, b;
      for (int i = 0; i < 3; ++i) {
        a[i] = z[i] - along * N(u1[i]);
        b[i] = k[i] - along * N(u1[i]);
      }
      const Terms first = in_range(0, dot(a, b), dot(cross(u1, a), b), d);
      terms.verdict = both(terms.verdict, first.verdict);
      terms.bounds.append(first.bounds);
      return terms;
    };
    return either(reach, reach_bounds, posture(1), posture(-1), out);
  }

 public:
  static bool turns_round(const machine::JointRange& range) {
    return range.max - range.min >= 2 * std::numbers::pi - 1e-9;
  }

 private:
  const machine::Stages& stages_;
  machine::TipLimits module_tip_;
  int first_of_wrist_;
  std::vector<machine::JointRange> ranges_;
};

/// Whether its workspace is proven: a wrist on a module of legs, whose third joint, if it has one, turns all the way
/// round.
inline bool bounded(const machine::Stages& m) {
  const auto form = machine::WristOnModule::of(m);
  if (!form || !form->placing()) return false;
  return m.data[1].joints < 3 || WristLimits::turns_round(kinematics::joint_range(m.machines[1], 2));
}

inline Result<WristLimits> bounds_of(const machine::Stages& m, const Options& options) {
  POLYPOD_TRY(held_by(m.task, m.name, options.directions));
  if (!bounded(m)) return no_bounds(m.name);
  return WristLimits(m, std::make_shared<const machine::WristOnModule>(*machine::WristOnModule::of(m)), options);
}

}  // namespace polypod::workspace
