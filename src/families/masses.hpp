// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Where the parts of a machine are that have mass. A family answers what it has of these questions, on power series:
//   MassParts mass_parts(m)                       which parts it has; none without
//   std::vector<MassLeg> mass_legs(m, X, q, p)    its legs; none without
//   PoseT<Series> mass_link(m, row, q, p)         the frame of a link that moves by itself (rows 0 .. links - 1)
//   int joint_of_element(m, element)              which joint moves as an element (`elements`) deflects, kNoJoint: none
//   std::string no_masses(m)                      why its masses are not known; empty without
#pragma once

#include <string>
#include <vector>

#include "polypod/core/series.hpp"
#include "polypod/geometry/pose.hpp"

namespace polypod::machine {

/// What a machine has of each kind.
struct MassParts {
  bool struts = false, rods = false, sliders = false, arms = false;
  int links = 0;
};

/// A leg: what stands still, what the drive moves, and the joint of the platform.
struct MassLeg {
  Vector3<Series> fixed, driven, platform;
  bool strut = false, rail = false, crank = false;
};

inline constexpr int kNoJoint = -1;    ///< the element deflects while the drives stand
inline constexpr int kHeldJoint = -2;  ///< it is a joint that is locked, which moves no mass

/// A point of the platform that moves.
inline Vector3<Series> moved_point(const PoseT<Series>& X, const Vec3& local) {
  Vector3<Series> out;
  for (int i = 0; i < 3; ++i) {
    out[i] = X.p[i] + X.R(i, 0) * Series(local[0]) + X.R(i, 1) * Series(local[1]) + X.R(i, 2) * Series(local[2]);
  }
  return out;
}

}  // namespace polypod::machine
