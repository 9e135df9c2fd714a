// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machine/arm_of_axes.hpp"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

namespace polypod::machine {
namespace {

constexpr double kParallel = 1e-13;       // rad: what a few products of rotations leave of parallel axes
constexpr double kNearlyParallel = 1e-3;  // the normal of such axes lies up to a thousand times their distance away
constexpr double kMeet = 1e-13;           // m: the common normal has no direction of its own

/// A direction square to z that is nearest to `wanted`, or to `otherwise` where that is z.
Vec3 across(const Vec3& z, const Vec3& wanted, const Vec3& otherwise) {
  constexpr double kOwn = 1e-6;
  Vec3 x = wanted - wanted.dot(z) * z;
  if (x.norm() < kOwn) x = otherwise - otherwise.dot(z) * z;
  x.normalize();
  return (x - x.dot(z) * z).normalized();
}

Pose frame_of(const Vec3& origin, const Vec3& x, const Vec3& z) {
  Pose X;
  X.R.col(0) = x;
  X.R.col(1) = z.cross(x);
  X.R.col(2) = z;
  X.p = origin;
  return X;
}

/// The angle about `axis` that turns `from` into `to`, both square to it; half a turn counts as positive.
double angle_about(const Vec3& axis, const Vec3& from, const Vec3& to) {
  constexpr double kRounding = 1e-15;
  const double angle = std::atan2(axis.dot(from.cross(to)), from.dot(to));
  return angle < kRounding - std::numbers::pi ? std::numbers::pi : angle;
}

/// A table that grows axis by axis.
class Table {
 public:
  Table(const Vec3& origin, const Vec3& x, const Vec3& z) : first_(frame_of(origin, x, z)), last_(first_) {}

  [[nodiscard]] const Pose& first() const { return first_; }
  [[nodiscard]] const Pose& last() const { return last_; }
  [[nodiscard]] std::vector<DhRow>& rows() { return rows_; }

  /// A row from the last frame to one on the line through `point` along the unit vector z.
  void lead_to(const Vec3& point, Vec3 z) {
    const Vec3 o = last_.p, x0 = last_.R.col(0), z0 = last_.R.col(2);
    const Vec3 n = z0.cross(z), between = point - o;
    const double sine = n.norm();
    DhRow row;
    Vec3 x, origin;
    if (sine < kParallel) {
      z = z0.dot(z) > 0 ? z0 : Vec3(-z0);
      const Vec3 off = between - between.dot(z0) * z0;
      row.a = off.norm();
      if (row.a < kMeet) row.a = 0;
      x = row.a > 0 ? across(z0, off, off) : x0;
      origin = o + row.a * x;
    } else {
      x = n / sine;
      row.a = between.dot(x);
      if (std::abs(row.a) < kMeet) row.a = 0;
      if (row.a < 0 || (row.a == 0 && x.dot(x0) < -kMeet)) {
        x = -x;
        row.a = -row.a;
      }
      row.d = between.cross(z).dot(n) / (sine * sine);
      origin = o + row.d * z0 + row.a * x;
    }
    row.theta_offset = angle_about(z0, x0, x);
    row.alpha = angle_about(x, z0, z);
    last_ = frame_of(origin, x, z);
    rows_.push_back(row);
  }

  /// The row that ends on its own axis, next to the origin of `X_MF`, with x as near as can be to its.
  void end_at(const Pose& X_MF) {
    const Vec3 x0 = last_.R.col(0), z = last_.R.col(2);
    DhRow row;
    row.d = (X_MF.p - last_.p).dot(z);
    const Vec3 x = across(z, X_MF.R.col(0), X_MF.R.col(1));
    row.theta_offset = angle_about(z, x0, x);
    last_ = frame_of(last_.p + row.d * z, x, z);
    rows_.push_back(row);
  }

 private:
  Pose first_, last_;
  std::vector<DhRow> rows_;
};

}  // namespace

Result<SerialArm> arm_of_axes(std::span<const JointAxis> axes, const Pose& X_MT, const Pose& X_MF) {
  if (axes.empty()) return fail("MA191", "no joint of the chain moves");
  // The sense of an axis is free: a joint may count against it.
  const auto sense = [&](std::size_t i) {
    const Vec3& w = axes[i].direction;
    if (i == 0) return w.z() < -kMeet ? -1.0 : 1.0;
    if (i + 1 == axes.size()) return w.dot(X_MF.R.col(2)) < -kMeet ? -1.0 : 1.0;
    return 1.0;
  };
  const Vec3 z = sense(0) * axes[0].direction;
  const bool turns = axes[0].kind == JointKind::revolute;
  const Vec3 origin = turns ? Vec3(axes[0].point - axes[0].point.dot(z) * z) : Vec3(Vec3::Zero());
  Table table(origin, across(z, Vec3::UnitX(), Vec3::UnitY()), z);
  std::vector<std::size_t> row_of{0};
  for (std::size_t i = 1; i < axes.size(); ++i) {
    const Vec3 next = sense(i) * axes[i].direction, now = table.last().R.col(2);
    if (const double sine = now.cross(next).norm(); sine >= kParallel && sine < kNearlyParallel) {
      // Across both, from the axis at the height of the next one's foot towards that foot.
      const Vec3 o = table.last().p;
      const Vec3 foot = axes[i].point + (o - axes[i].point).dot(next) * next;
      const double height = (foot - o).dot(now);
      table.lead_to(o + height * now, across(now, foot - o, table.last().R.col(0)));
      const std::size_t aside = table.rows().size();
      table.lead_to(axes[i].point, next);
      table.rows()[aside].locked = 0.0;
    } else {
      table.lead_to(axes[i].point, next);
    }
    row_of.push_back(table.rows().size());
  }
  table.end_at(X_MF);
  if (table.rows().size() > static_cast<std::size_t>(kMaxJoints)) {
    return fail("MA191", fmt::format("the chain has {} moving joints and its table {} rows, but at most {} are taken",
                                     axes.size(), table.rows().size(), kMaxJoints));
  }
  SerialArm arm;
  arm.dh = std::move(table.rows());
  for (std::size_t i = 0; i < axes.size(); ++i) {
    DhRow& row = arm.dh[row_of[i]];
    row.kind = axes[i].kind;
    row.sign = sense(i);
    if (axes[i].follows) {
      row.locked = axes[i].offset;
      row.range = {axes[i].offset, axes[i].offset};
      row.coupled_back = static_cast<int>(row_of[i] - row_of[*axes[i].follows]);
      row.coupling = row.sign * axes[i].multiplier;
      continue;
    }
    row.range = axes[i].range;
    row.speed = axes[i].speed;
  }
  arm.X_MB = table.first();
  arm.X_FT = table.last().inverse() * X_MT;
  return arm;
}

}  // namespace polypod::machine
