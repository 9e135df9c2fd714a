// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The limits at one pose, for fields of margins (see src/workspace/margin.cpp).
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

#include "../../workspace/judge.hpp"
#include "redundant.hpp"

namespace polypod::workspace {

/// Whether a turning joint has any angle in some turn: its limits then end nothing.
inline bool is_whole_turn(double low, double high) {
  return high - low >= 2 * std::numbers::pi - 1e-9;
}

/// Arms with the closed wrist inverse: any of its branches may keep the limits.
class ArmJudge {
 public:
  static constexpr int kBranches = machine::WristInverse::kBranches;
  std::vector<Slot> slots;

  ArmJudge(const machine::WristInverse& inverse, LimitBits heeded) : inverse_(inverse), f_(inverse.form()) {
    const double size = std::abs(f_.a1) + f_.a2 + std::abs(f_.d4) + f_.reach;
    for (int i = 0; i < 10; ++i) {
      const auto joint = static_cast<std::size_t>(i / 2);
      if ((heeded >> i & 1U) != 0 && !is_whole_turn(f_.min[joint], f_.max[joint])) slots.push_back({i, size});
    }
    slots.push_back({kOutOfReach, 1});
  }

  /// The tool axes that lie along the forearm. A limit of joint 5 just short of that forbids a thin cone round them,
  /// which samples miss. In the plane of the arm, elbow = p + L k with L = reach +- d4, at the distance a2 from
  /// joint 2.
  [[nodiscard]] std::vector<Vec3> critical(const Vec3& p_M) const {
    std::vector<Vec3> out;
    const Vec3 p = f_.X_BM * p_M;
    const double r = std::hypot(p.x(), p.y());
    if (!(r > 0)) return out;
    const Vec3 along(p.x() / r, p.y() / r, 0);
    const Eigen::Vector2d to_tip(r, p.z() - f_.d1);
    for (const double side : {1.0, -1.0})
      for (const double L : {f_.reach + f_.d4, f_.reach - f_.d4}) {
        const Eigen::Vector2d from_joint = to_tip - Eigen::Vector2d(side * f_.a1, 0);
        const double distance = from_joint.norm();
        const double cosine = (f_.a2 * f_.a2 - distance * distance - L * L) / (2 * L * distance);
        if (!(std::abs(cosine) <= 1)) continue;
        const double middle = std::atan2(from_joint.y(), from_joint.x()), turn = std::acos(cosine);
        for (const double angle : {middle + turn, middle - turn}) {
          const Vec3 k = std::cos(angle) * along + std::sin(angle) * Vec3::UnitZ();
          out.push_back(f_.X_BM.R.transpose() * k);
        }
      }
    return out;
  }

  void values(const Pose& X, double* out) const {
    machine::WristInverse::Branches branches;
    const Vec3 k = X.R.col(2);
    inverse_.solve(X.p, k, branches);
    const Vec3 c = f_.X_BM * X.p + f_.reach * (f_.X_BM.R * k);
    const double r = std::hypot(c.x(), c.y()), height = c.z() - f_.d1;
    for (int b = 0; b < kBranches; ++b) {
      const double rho = ((b & 2) == 0 ? r : -r) - f_.a1, distance = std::hypot(rho, height);
      const double reach = std::min(f_.a2 + std::abs(f_.d4) - distance, distance - std::abs(f_.a2 - std::abs(f_.d4)));
      for (const Slot& slot : slots) {
        if (slot.limit == kOutOfReach) {
          *out++ = reach;
        } else if (!branches.exists[b]) {
          *out++ = kUnknown;
        } else {
          const auto joint = static_cast<std::size_t>(slot.limit / 2);
          const double q = branches.joints[b][slot.limit / 2];
          *out++ = slot.scale * (slot.limit % 2 == 0 ? q - f_.min[joint] : f_.max[joint] - q);
        }
      }
    }
  }

 private:
  machine::WristInverse inverse_;
  machine::WristInverse::Form f_;
};

/// Nothing where the arm does not have the wrist of WristInverse.
inline std::optional<ArmJudge> pose_judge(const machine::SerialArm& arm, const Options& options) {
  const auto closed = machine::WristInverse::of(arm);
  if (!closed) return {};
  return ArmJudge(*closed, options.limits);
}

/// Arms with one freedom more than their task holds: at each pose the joints that stay farthest from the limits.
class RedundantJudge {
 public:
  static constexpr int kBranches = 1;
  std::vector<Slot> slots;

  RedundantJudge(machine::RedundantInverse inverse, const machine::SerialArm& arm, const Options& options)
      : inverse_(std::move(inverse)), scales_(static_cast<std::size_t>(2 * joint_count(arm)), 0.0) {
    for (int i = 0; i < joint_count(arm); ++i) ranges_.push_back(joint_range(arm, i));
    for (const Slot& slot : slots_of(arm, options)) {
      const auto joint = static_cast<std::size_t>(slot.limit / 2);
      if (joint_kind(arm, slot.limit / 2) == machine::JointKind::revolute &&
          is_whole_turn(ranges_[joint].min, ranges_[joint].max))
        continue;
      slots.push_back(slot);
      scales_[static_cast<std::size_t>(slot.limit)] = slot.scale;
    }
    slots.push_back({kOutOfReach, 1});
  }

  [[nodiscard]] static std::vector<Vec3> critical(const Vec3&) { return {}; }

  void values(const Pose& X, double* out) const {
    const std::optional<machine::JointVector> q = inverse_.roomiest(X, scales_);
    for (const Slot& slot : slots) {
      if (slot.limit == kOutOfReach) {
        *out++ = q ? kUnknown : -kUnknown;
      } else if (!q) {
        *out++ = kUnknown;
      } else {
        const machine::JointRange& range = ranges_[static_cast<std::size_t>(slot.limit / 2)];
        const double at = (*q)[slot.limit / 2];
        *out++ = slot.scale * (slot.limit % 2 == 0 ? at - range.min : range.max - at);
      }
    }
  }

 private:
  machine::RedundantInverse inverse_;
  std::vector<double> scales_;
  std::vector<machine::JointRange> ranges_;
};

/// Nothing where the arm has no such freedom, or its limits, within which it is looked for, do not count.
inline std::optional<RedundantJudge> redundant_judge(const machine::SerialArm& arm, const Options& options) {
  if (has_closed_inverse(arm)) return {};
  auto inverse = machine::RedundantInverse::of(arm);
  if (!inverse || (inverse->own_limits() & ~options.limits) != 0) return {};
  return RedundantJudge(*std::move(inverse), arm, options);
}

}  // namespace polypod::workspace
