// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The two points at given distances from three points.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "polypod/geometry/pose.hpp"

namespace polypod {

/// Both intersections of three spheres: `above` on the side of (C2 - C1) x (C3 - C1), `below` its mirror image.
struct TwoPoints {
  Vec3 above = Vec3::Zero(), below = Vec3::Zero();
  /// Squared distance of either point from the plane of the centres; negative: the spheres have no common point, and
  /// both points are the one on the plane of equal power. -inf where the centres lie on a line.
  double height2 = 0;
  [[nodiscard]] bool real() const { return height2 >= 0; }
};

/// With e = C2 - C1, f = C3 - C1, n = e x f the point of the centres' plane of equal power to the spheres is
///   C1 + (k_e f x n + k_f n x e) / |n|^2 = C1 + (k_e (f.f e - e.f f) + k_f (e.e f - e.f e)) / |n|^2,  k_e = (|e|^2 +
///   r1^2 - r2^2) / 2,  k_f = (|f|^2 + r1^2 - r3^2) / 2,
/// and the points lie square to the plane at sqrt(r1^2 - its squared distance from C1) from it. The same points as KOZ
/// appendix B (4) to (15), without its auxiliary frame. Two solutions, one (double) where they touch, none or, with
/// centres on a line, none that is isolated. Ill-conditioned where the two points meet. Cost: 10 ns.
inline TwoPoints trilaterate(const std::array<Vec3, 3>& center, const std::array<double, 3>& radius) {
  const Vec3 e = center[1] - center[0], f = center[2] - center[0], n = e.cross(f);
  const double ee = e.squaredNorm(), ff = f.squaredNorm(), nn = n.squaredNorm(), r2 = radius[0] * radius[0];
  TwoPoints out;
  if (!(nn > 1e-24 * ee * ff)) {
    out.above = out.below = center[0];
    out.height2 = -std::numeric_limits<double>::infinity();
    return out;
  }
  const double k_e = 0.5 * (ee + r2 - radius[1] * radius[1]), k_f = 0.5 * (ff + r2 - radius[2] * radius[2]);
  const double ef = e.dot(f), inverse = 1 / nn;
  const Vec3 foot = (inverse * (k_e * ff - k_f * ef)) * e + (inverse * (k_f * ee - k_e * ef)) * f;
  out.height2 = r2 - foot.squaredNorm();
  const Vec3 up = std::sqrt(std::max(0.0, out.height2) * inverse) * n;
  out.above = center[0] + foot + up;
  out.below = center[0] + foot - up;
  return out;
}

}  // namespace polypod
