// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Kinematics of a family of one's own: its closed forms, else what its closure gives.
#pragma once

#include <optional>
#include <type_traits>

#include "polypod/families/own/questions.hpp"
#include "polypod/kinematics/closure.hpp"

namespace polypod::machine {

inline int joint_count(const Own& m) {
  return m.questions->joints();
}
inline JointKind joint_kind(const Own& m, int joint) {
  return m.questions->kind(joint);
}
inline JointRange joint_range(const Own& m, int joint) {
  return m.questions->range(joint);
}
inline Task task(const Own& m) {
  return m.questions->prescribes();
}
template <class T>
ClosureVectorT<T> closure(const Own& m, const PoseT<T>& X_MT, std::span<const T> q, std::span<const T> p) {
  return m.questions->equations(X_MT, q, p);
}
/// Its equations are virtual: on numbers, dual numbers, intervals and first-order numbers.
constexpr std::true_type closure_takes_no_series(const Own&) {
  return {};
}
/// Certain workspaces follow from closure and limits over boxes.
constexpr void bounds_follow_from_closure(const Own&) {}
template <class T>
std::vector<T> limits(const Own& m, const PoseT<T>& X_MT, std::span<const T> q, std::span<const T> p) {
  return m.questions->kept(X_MT, q, p);
}
inline std::string limit_name(const Own& m, int limit) {
  return m.questions->limit_called(limit);
}
/// The family's own, else one group "limit" of lengths that all are given.
LimitTable limit_table(const Own& m);

/// The family's own, else what Newton's method finds from R = 1, p = 0 with the joints in the middle of their ranges.
Pose home_pose(const Own& m);

/// The family's own, else Newton's method from home; where that ends nowhere, by joints between those of home and q.
kinematics::NewtonResult forward_from_home(const Own& m, const JointVector& q);
Pose forward(const Own& m, const JointVector& q);

/// The family's own, else inverse_by_closure: by a search, not proven to be all.
kinematics::InverseResult inverse(const Own& m, const Pose& X_MT);
bool has_closed_inverse(const Own& m);
kinematics::InverseResult inverse_from(const Own& m, const Pose& X_MT, const JointVector& start);
/// "only" of a closed form without names, else "posture 1", ...
std::string branch_name(const Own& m, unsigned branch);

/// The whole pose at the joints q next to X_MT: Newton's method from there, X_MT where it finds none.
Pose settled(const Own& m, const Pose& X_MT, const JointVector& q);
/// The same of the first solution of the inverse.
std::optional<Pose> settled(const Own& m, const Pose& X_MT);

/// The family's own, else J = -A^-1 B at the settled pose.
JacobianMatrix jacobian(const Own& m, const Pose& X_MT, const JointVector& q);

static_assert(kinematics::Machine<Own>);

}  // namespace polypod::machine
