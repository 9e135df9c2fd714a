// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the families know of their masses (families/masses.hpp), with defaults for those that answer a question not.
#pragma once

#include "delta/masses.hpp"
#include "hexapod/masses.hpp"
#include "own/masses.hpp"
#include "parallel/masses.hpp"
#include "polypod/kinematics/families.hpp"
#include "polypod/kinematics/parts.hpp"
#include "serial/masses.hpp"
#include "stages/masses.hpp"

namespace polypod::motion {

template <class M>
machine::MassParts parts_with_mass(const M& m) {
  if constexpr (requires { mass_parts(m); }) return mass_parts(m);
  return {};
}

template <class M, class T>
std::vector<machine::MassLeg<T>> legs_with_mass(const M& m, const PoseT<T>& X, std::span<const T> q) {
  if constexpr (requires { mass_legs(m, X, q); }) return mass_legs(m, X, q);
  return {};
}

/// The machines that a machine in series is made of; none of others.
template <class M>
std::span<const machine::AnyMachine> stages_with_mass(const M& m) {
  if constexpr (requires { mass_stages(m); }) return mass_stages(m);
  return {};
}

template <class M>
int joint_moved_by(const M& m, int element) {
  if constexpr (requires { joint_of_element(m, element); }) return joint_of_element(m, element);
  int joints = 0;
  for (const machine::AnyMachine& stage : stages_with_mass(m)) {
    const auto own = static_cast<int>(kinematics::elements(stage).size());
    if (element < own) {
      const int joint = std::visit([element](const auto& s) { return joint_moved_by(s, element); }, stage);
      return joint < 0 ? joint : joints + joint;
    }
    element -= own;
    joints += kinematics::joint_count(stage);
  }
  return machine::kNoJoint;
}

template <class M>
std::string why_no_masses(const M& m) {
  if constexpr (requires { no_masses(m); }) return no_masses(m);
  for (const machine::AnyMachine& stage : stages_with_mass(m)) {
    std::string why = std::visit([](const auto& s) { return why_no_masses(s); }, stage);
    if (!why.empty()) return why;
  }
  return {};
}

}  // namespace polypod::motion
