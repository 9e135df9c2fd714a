// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>

#include "../masses.hpp"
#include "polypod/families/parallel/kinematics.hpp"
#include "polypod/geometry/fixed_point.hpp"

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

template <class T>
std::vector<MassLeg<T>> mass_legs(const Parallel& m, const PoseT<T>& X, std::span<const T> q) {
  std::vector<MassLeg<T>> out;
  out.reserve(m.legs.size());
  std::size_t drive = 0;
  for (const ParallelLeg& leg : m.legs) {
    const T value = leg.driven() ? q[drive++] + T(leg.two_roots() ? leg.zero_offset : 0.0) : T(0.0);
    MassLeg<T> line;
    for (int k = 0; k < 3; ++k) line.fixed[k] = T(leg.base[k]);
    line.driven = line.fixed;
    line.strut = leg.drive == LegDrive::strut;
    line.rail = leg.drive == LegDrive::rail;
    line.crank = leg.drive == LegDrive::crank;
    const Vec3 side = leg.axis.cross(leg.zero);
    for (int k = 0; k < 3; ++k) {
      if (line.rail) line.driven[k] += value * T(leg.rail[k]);
      if (line.crank) {
        line.driven[k] += T(leg.arm) * (cos(value) * T(leg.zero[k]) + sin(value) * T(side[k]));
      }
    }
    if (leg.ring) {
      // The point of the ring in the half plane of the base joint.
      Vector3<T> d;
      for (int k = 0; k < 3; ++k) {
        d[k] = T(-(leg.ring->center[k] - m.tool[k]));
        for (int c = 0; c < 3; ++c) d[k] += X.R(c, k) * (line.fixed[c] - X.p[c]);
      }
      T along(0.0);
      for (int k = 0; k < 3; ++k) along += d[k] * T(leg.ring->axis[k]);
      Vector3<T> across;
      for (int k = 0; k < 3; ++k) across[k] = d[k] - along * T(leg.ring->axis[k]);
      const T scale = T(leg.ring->radius) / sqrt(across[0] * across[0] + across[1] * across[1] + across[2] * across[2]);
      Vector3<T> local;
      for (int k = 0; k < 3; ++k) local[k] = T(leg.ring->center[k] - m.tool[k]) + scale * across[k];
      for (int k = 0; k < 3; ++k) {
        line.platform[k] = X.p[k] + X.R(k, 0) * local[0] + X.R(k, 1) * local[1] + X.R(k, 2) * local[2];
      }
    } else {
      line.platform = fixed_point(X, Vec3(leg.platform - m.tool));
      for (int k = 0; k < 3; ++k) line.platform[k] += T(leg.still[k]);
    }
    out.push_back(line);
  }
  return out;
}

}  // namespace polypod::machine
