// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/hexapod/kinematics.hpp"

#include <fmt/format.h>

#include <cmath>
#include <limits>

namespace polypod::machine {
namespace {

/// Solves the 6 x 6 system M x = b in place by elimination with row pivots; false where a pivot vanishes.
bool solve_six(double (&M)[6][6], double (&b)[6]) {
  for (int k = 0; k < 6; ++k) {
    int pivot = k;
    for (int i = k + 1; i < 6; ++i)
      if (std::abs(M[i][k]) > std::abs(M[pivot][k])) pivot = i;
    if (!(std::abs(M[pivot][k]) > 0)) return false;
    if (pivot != k) {
      for (int j = k; j < 6; ++j) std::swap(M[k][j], M[pivot][j]);
      std::swap(b[k], b[pivot]);
    }
    const double inverse = 1 / M[k][k];
    for (int i = k + 1; i < 6; ++i) {
      const double factor = M[i][k] * inverse;
      for (int j = k + 1; j < 6; ++j) M[i][j] -= factor * M[k][j];
      b[i] -= factor * b[k];
    }
    M[k][k] = inverse;
  }
  for (int k = 5; k >= 0; --k) {
    double x = b[k];
    for (int j = k + 1; j < 6; ++j) x -= M[k][j] * b[j];
    b[k] = x * M[k][k];
  }
  return true;
}

}  // namespace

LimitTable hexapod_limit_table(const TipLimits& tip, double leg, bool joints, bool legs, bool base) {
  using L = HexapodLimits;
  LimitTable out(L::kBaseJoint, {"length", 1, true, false, true});
  out.insert(out.end(), L::kPlatformJoint - L::kBaseJoint, {"base-joint", leg, joints});
  out.insert(out.end(), L::kLegPair - L::kPlatformJoint, {"platform-joint", leg, joints});
  out.insert(out.end(), L::kBasePlane - L::kLegPair, {"legs", 1, legs, true});
  out.insert(out.end(), L::kLow - L::kBasePlane, {"base", 1, base});
  push_tip_limits(out, tip);
  return out;
}

std::string hexapod_limit_name(int limit) {
  const int leg = limit % kLegs + 1;
  if (limit >= HexapodLimits::kBaseJoint && limit < HexapodLimits::kPlatformJoint) {
    return fmt::format("base joint {} beyond its limit", leg);
  }
  if (limit >= HexapodLimits::kPlatformJoint && limit < HexapodLimits::kLegPair) {
    return fmt::format("platform joint {} beyond its limit", leg);
  }
  int pair = HexapodLimits::kLegPair;
  for (int i = 1; i <= kLegs; ++i)
    for (int j = i + 1; j <= kLegs; ++j)
      if (pair++ == limit) return fmt::format("legs {} and {} collide", i, j);
  if (limit < HexapodLimits::kLow) return fmt::format("leg {} behind the base", limit - HexapodLimits::kBasePlane + 1);
  if (limit < HexapodLimits::kHigh)
    return fmt::format("{} below its smallest value", "xyz"[limit - HexapodLimits::kLow]);
  return fmt::format("{} above its largest value", "xyz"[(limit - HexapodLimits::kHigh) % 3]);
}

Mat6 leg_rows(const Pose& X, const SixPoints& anchor, const SixPoints& end) {
  Mat6 K;
  for (int i = 0; i < kLegs; ++i) {
    const Vec3 arm = X.R * end[i];
    const Vec3 y = X.p + arm - anchor[i];
    const double length = y.norm();
    const Vec3 w = length > 0 ? Vec3(y / length) : Vec3(Vec3::Zero());
    K.row(i) << w.transpose(), arm.cross(w).transpose();
  }
  return K;
}

kinematics::NewtonResult newton_on_legs(const SixLegs& legs, const Pose& seed, const LegNewtonOptions& options) {
  kinematics::NewtonResult out{seed, 0, 0, false};
  Pose& X = out.X_MT;
  double size = 0;
  for (int i = 0; i < kLegs; ++i) size = std::max({size, legs.length[i], legs.end[i].norm()});
  const double step_bound = std::sqrt(options.tolerance) * size;
  for (; out.iterations < options.max_iterations && !out.converged; ++out.iterations) {
    double M[6][6], b[6];
    for (int i = 0; i < kLegs; ++i) {
      const Vec3 arm = X.R * legs.end[i];
      const Vec3 y = X.p + arm - legs.anchor[i];
      const double length = y.norm();
      // Rows times the length: no division, and a leg of no length gives a row of zeros, not NaN.
      const Vec3 moment = arm.cross(y);
      for (int k = 0; k < 3; ++k) {
        M[i][k] = y[k];
        M[i][3 + k] = moment[k];
      }
      // |y + dy|^2 = l^2 in first order: the squared form has one kind of curvature less than the lengths.
      b[i] = 0.5 * (legs.length[i] - length) * (legs.length[i] + length);
    }
    if (!solve_six(M, b)) break;
    Vec3 v(b[0], b[1], b[2]), w(b[3], b[4], b[5]);
    const double turn = w.norm();
    const double step = std::max(v.norm(), size * turn);
    if (!(step < std::numeric_limits<double>::infinity())) break;
    const double longest = 0.7 * size;  // stay where first order says something
    if (step > longest) {
      v *= longest / step;
      w *= longest / step;
    }
    X.p += v;
    X.R = rotation_of(w) * X.R;
    out.converged = step <= step_bound;
  }
  for (int i = 0; i < kLegs; ++i) {
    out.residual = std::max(out.residual, std::abs((X * legs.end[i] - legs.anchor[i]).norm() - legs.length[i]));
  }
  out.converged = out.converged && out.residual <= 1e-11 * size;
  return out;
}

}  // namespace polypod::machine
