// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the families know of their masses (families/masses.hpp), with defaults for those that answer a question not.
#pragma once

#include "delta/masses.hpp"
#include "hexapod/masses.hpp"
#include "own/masses.hpp"
#include "parallel/masses.hpp"
#include "polypod/kinematics/families.hpp"
#include "serial/masses.hpp"
#include "stages/masses.hpp"

namespace polypod::motion {

template <class M>
machine::MassParts parts_with_mass(const M& m) {
  if constexpr (requires { mass_parts(m); }) return mass_parts(m);
  return {};
}

template <class M>
std::vector<machine::MassLeg> legs_with_mass(const M& m, const PoseT<Series>& X, std::span<const Series> q,
                                             std::span<const Series> p) {
  if constexpr (requires { mass_legs(m, X, q, p); }) return mass_legs(m, X, q, p);
  return {};
}

template <class M>
int joint_moved_by(const M& m, int element) {
  if constexpr (requires { joint_of_element(m, element); }) return joint_of_element(m, element);
  return machine::kNoJoint;
}

template <class M>
std::string why_no_masses(const M& m) {
  if constexpr (requires { no_masses(m); }) return no_masses(m);
  return {};
}

}  // namespace polypod::motion
