// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A library user's own family that is a machine of legs in disguise: what follows from closure and limits alone beside
// the built-in family's closed forms.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/kinematics/families.hpp"

namespace polypod::legs_alone {

/// A machine of legs of the catalogue with none of its closed forms: the concept's functions alone.
struct Legs {
  static constexpr std::string_view kFamily = "legs-alone";
  machine::Parallel m;
};
inline std::string to_toml(const Legs&) {
  return "";
}
inline int joint_count(const Legs& l) {
  return joint_count(l.m);
}
inline machine::JointKind joint_kind(const Legs& l, int i) {
  return joint_kind(l.m, i);
}
inline machine::JointRange joint_range(const Legs& l, int i) {
  return joint_range(l.m, i);
}
inline machine::Task task(const Legs& l) {
  return task(l.m);
}
inline std::vector<machine::Parameter> parameters(const Legs& l) {
  return parameters(l.m);
}
template <class T>
machine::ClosureVectorT<T> closure(const Legs& l, const PoseT<T>& X, std::span<const T> q, std::span<const T> p) {
  return closure(l.m, X, q, p);
}
template <class T>
std::vector<T> limits(const Legs& l, const PoseT<T>& X, std::span<const T> q, std::span<const T> p) {
  return limits(l.m, X, q, p);
}
inline std::string limit_name(const Legs& l, int i) {
  return limit_name(l.m, i);
}
inline Pose home_pose(const Legs& l) {
  return home_pose(l.m);
}

}  // namespace polypod::legs_alone
