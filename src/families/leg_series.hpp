// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Drives of legs that each follow the tool by themselves, on power series: no linear system.
#pragma once

#include <algorithm>
#include <cmath>

#include "polypod/core/series.hpp"
#include "polypod/geometry/fixed_point.hpp"
#include "polypod/machine/common.hpp"

namespace polypod::machine {

/// A pose that moves, and the drives with it.
struct QuickSeries {
  PoseT<Series> X;
  JointVectorT<Series> q;
  /// The least share of a leg's force that its drive bears, 0 to 1; 0 where it moves while the tool is at rest (type
  /// 1), and the series of that leg are not finite.
  double pivot = 1;

  void add(int i, const Series& joint, double share) {
    q[i] = joint;
    pivot = std::min(pivot, std::abs(share));
  }
};

inline Series dot(const Vector3<Series>& a, const Vec3& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
inline Series squared_length(const Vector3<Series>& a) {
  return a[0] * a[0] + a[1] * a[1] + a[2] * a[2];
}

/// The travel q along a rail from a point, the platform joint at y from there: |y - q u| = l next to the travel `near`.
/// With q = u . y + r: r^2 = (u . y)^2 - |y|^2 + l^2.
inline void add_rail(int i, const Vector3<Series>& y, const Vec3& u, double l, double near, QuickSeries& out) {
  const Series along = dot(y, u), square = along * along - squared_length(y);
  Series r(near - along.value());
  r[1] = square[1] / (2 * r[0]);
  r[2] = (square[2] - r[1] * r[1]) / (2 * r[0]);
  r[3] = (square[3] - 2 * r[1] * r[2]) / (2 * r[0]);
  out.add(i, along + r, r[0] / l);
}

/// The angle q of a crank d (sin(q + zero) o - cos(q + zero) z) about a point, the platform joint at y from there, with
/// a rod l next to the angle `near`. The crank has length d, so that
///   a sin(t) + b cos(t) = g,  a = y . o, b = -y . z, g = (|y|^2 + d^2 - l^2) / (2 d),
/// and with t = near + zero + f, A = a cos - b sin and B = a sin + b cos of near + zero:  A sin(f) + B cos(f) = g.
inline void add_crank(int i, const Vector3<Series>& y, const Vec3& o, double d, double zero, double l, double near,
                      QuickSeries& out) {
  const double c = std::cos(near + zero), s = std::sin(near + zero);
  const Series a = dot(y, o), b = -y[2], g = squared_length(y) * (0.5 / d);
  const Series A = a * c - b * s, B = a * s + b * c, rest = g - B;
  Series f(0.0);  // sin(f) = f - f^3 / 6, cos(f) = 1 - f^2 / 2
  f[1] = rest[1] / A[0];
  f[2] = (rest[2] - A[1] * f[1] + B[0] * f[1] * f[1] / 2) / A[0];
  f[3] = (rest[3] - A[1] * f[2] - A[2] * f[1] + B[0] * f[1] * f[2] + B[1] * f[1] * f[1] / 2) / A[0] +
         f[1] * f[1] * f[1] / 6;
  out.add(i, Series(near) + f, A[0] / l);
}

}  // namespace polypod::machine
