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
  // Coordinate by coordinate: a vector that is stored so and loaded in pairs waits for its stores, twice the time.
  const double x1 = center[0].x(), y1 = center[0].y(), z1 = center[0].z();
  const double ex = center[1].x() - x1, ey = center[1].y() - y1, ez = center[1].z() - z1;
  const double fx = center[2].x() - x1, fy = center[2].y() - y1, fz = center[2].z() - z1;
  const double nx = ey * fz - ez * fy, ny = ez * fx - ex * fz, nz = ex * fy - ey * fx;
  const double ee = ex * ex + ey * ey + ez * ez, ff = fx * fx + fy * fy + fz * fz, ef = ex * fx + ey * fy + ez * fz;
  const double nn = nx * nx + ny * ny + nz * nz, r2 = radius[0] * radius[0];
  TwoPoints out;
  if (!(nn > 1e-24 * ee * ff)) {
    out.above = out.below = center[0];
    out.height2 = -std::numeric_limits<double>::infinity();
    return out;
  }
  const double k_e = 0.5 * (ee + r2 - radius[1] * radius[1]), k_f = 0.5 * (ff + r2 - radius[2] * radius[2]);
  const double inverse = 1 / nn, a = inverse * (k_e * ff - k_f * ef), b = inverse * (k_f * ee - k_e * ef);
  const double gx = a * ex + b * fx, gy = a * ey + b * fy, gz = a * ez + b * fz;  // from C1 to the point of equal power
  out.height2 = r2 - (gx * gx + gy * gy + gz * gz);
  const double up = std::sqrt(std::max(0.0, out.height2) * inverse);
  out.above = {x1 + gx + up * nx, y1 + gy + up * ny, z1 + gz + up * nz};
  out.below = {x1 + gx - up * nx, y1 + gy - up * ny, z1 + gz - up * nz};
  return out;
}

}  // namespace polypod
