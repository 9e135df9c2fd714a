// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Where the parts of a machine are that have mass. A family answers what it has of these questions, on any number type
// T (a motion is a power series, what a joint moves a dual number):
//   MassParts mass_parts(m)                           which parts it has; none without
//   std::vector<MassLeg<T>> mass_legs(m, X, q)        its legs; none without
//   std::vector<PoseT<T>> mass_links(m, q)            the frames of the links that move by themselves, one a row
//   int joint_of_element(m, element)                  which joint moves as an element (`elements`) deflects,
//                                                     kNoJoint: none
//   std::string no_masses(m)                          why its masses are not known; empty without
//   std::span<const AnyMachine> mass_stages(m)        the machines that it is made of, which have the masses;
//   each_mass_stage(m, X, q, take)                    take(k, X_MB, X, q): where each of them is and how it stands
#pragma once

#include <string>
#include <vector>

#include "polypod/geometry/pose.hpp"

namespace polypod::machine {

/// What a machine has of each kind.
struct MassParts {
  bool struts = false, rods = false, sliders = false, arms = false;
  int links = 0;
};

/// A leg: what stands still, what the drive moves, and the joint of the platform.
template <class T>
struct MassLeg {
  Vector3<T> fixed, driven, platform;
  bool strut = false, rail = false, crank = false;
};

inline constexpr int kNoJoint = -1;    ///< the element deflects while the drives stand
inline constexpr int kHeldJoint = -2;  ///< it is a joint that is locked, which moves no mass

}  // namespace polypod::machine
