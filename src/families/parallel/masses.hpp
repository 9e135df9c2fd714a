// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>

#include "../masses.hpp"
#include "polypod/families/parallel/kinematics.hpp"

namespace polypod::machine {

inline MassParts mass_parts(const Parallel& m) {
  MassParts out;
  for (const ParallelLeg& leg : m.legs) {
    out.struts = out.struts || leg.drive == LegDrive::strut;
    out.rods = out.rods || leg.drive != LegDrive::strut;
    out.sliders = out.sliders || leg.drive == LegDrive::rail;
    out.arms = out.arms || leg.drive == LegDrive::crank;
  }
  return out;
}

inline std::vector<MassLeg> mass_legs(const Parallel& m, const PoseT<Series>& X, std::span<const Series> q,
                                      std::span<const Series>) {
  std::vector<MassLeg> out;
  std::size_t drive = 0;
  for (const ParallelLeg& leg : m.legs) {
    const Series value = leg.driven() ? q[drive++] + Series(leg.two_roots() ? leg.zero_offset : 0.0) : Series(0.0);
    MassLeg line;
    for (int k = 0; k < 3; ++k) line.fixed[k] = Series(leg.base[k]);
    line.driven = line.fixed;
    line.strut = leg.drive == LegDrive::strut;
    line.rail = leg.drive == LegDrive::rail;
    line.crank = leg.drive == LegDrive::crank;
    const Vec3 side = leg.axis.cross(leg.zero);
    for (int k = 0; k < 3; ++k) {
      if (line.rail) line.driven[k] += value * Series(leg.rail[k]);
      if (line.crank) {
        line.driven[k] += Series(leg.arm) * (cos(value) * Series(leg.zero[k]) + sin(value) * Series(side[k]));
      }
    }
    if (leg.ring) {
      // The point of the ring in the half plane of the base joint.
      Vector3<Series> d;
      for (int k = 0; k < 3; ++k) {
        d[k] = Series(-(leg.ring->center[k] - m.tool[k]));
        for (int c = 0; c < 3; ++c) d[k] += X.R(c, k) * (line.fixed[c] - X.p[c]);
      }
      Series along;
      for (int k = 0; k < 3; ++k) along += d[k] * Series(leg.ring->axis[k]);
      Vector3<Series> across;
      for (int k = 0; k < 3; ++k) across[k] = d[k] - along * Series(leg.ring->axis[k]);
      const Series scale =
          Series(leg.ring->radius) / sqrt(across[0] * across[0] + across[1] * across[1] + across[2] * across[2]);
      Vector3<Series> local;
      for (int k = 0; k < 3; ++k) local[k] = Series(leg.ring->center[k] - m.tool[k]) + scale * across[k];
      for (int k = 0; k < 3; ++k) {
        line.platform[k] = X.p[k] + X.R(k, 0) * local[0] + X.R(k, 1) * local[1] + X.R(k, 2) * local[2];
      }
    } else {
      line.platform = moved_point(X, leg.platform - m.tool);
      for (int k = 0; k < 3; ++k) line.platform[k] += Series(leg.still[k]);
    }
    out.push_back(line);
  }
  return out;
}

}  // namespace polypod::machine
