// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The force of a ball by a plain sum, for tests of what computes it by rings.
#pragma once

#include <cmath>
#include <numbers>

#include "polypod/cutting/force.hpp"
#include "polypod/geometry/pose.hpp"

namespace polypod::cutting::samples {

/// The mean force by a sum over points of the ball, N: n from its shape, h = feed . n, forces along directions in
/// space. `met` says whether a point, seen from the tip, is in material that the ball has not yet cut.
template <class Met>
Vec3 by_points(const Cutter& cutter, const Material& m, const Vec3& d, double feed_per_tooth, Met&& met,
               int steps = 1000) {
  const double radius = cutter.radius(), pi = std::numbers::pi;
  Vec3 sum = Vec3::Zero();
  for (int i = 0; i < steps; ++i) {
    const double kappa = pi / 2 * (i + 0.5) / steps;
    for (int j = 0; j < steps; ++j) {
      const double phi = 2 * pi * (j + 0.5) / steps;
      const Vec3 out(std::sin(phi), std::cos(phi), 0);
      const Vec3 n = std::sin(kappa) * out - std::cos(kappa) * Vec3::UnitZ();
      const Vec3 p = radius * (n + Vec3::UnitZ());
      if (!(n.dot(d) > 0) || !met(p)) continue;
      const Vec3 motion = out.cross(Vec3::UnitZ()), along = motion.cross(n);
      const double h = feed_per_tooth * n.dot(d);
      sum += -(m.kte + m.ktc * h) * motion - (m.kre + m.krc * h) * n + (m.kae + m.kac * h) * along;
    }
  }
  return cutter.teeth / (2 * pi) * sum * (2 * pi / steps) * (radius * pi / 2 / steps);
}

/// The same with the tool turned by R about the middle of the ball; `met` sees points from the ball's lowest point, in
/// the frame of the stock, and d is in that frame.
template <class Met>
Vec3 by_points(const Cutter& cutter, const Material& m, const Mat3& R, const Vec3& d, double feed_per_tooth, Met&& met,
               int steps = 300) {
  const Vec3 up = cutter.radius() * Vec3::UnitZ();
  return R * by_points(
                 cutter, m, Vec3(R.transpose() * d), feed_per_tooth,
                 [&](const Vec3& p) { return met(Vec3(R * (p - up) + up)); }, steps);
}

}  // namespace polypod::cutting::samples
