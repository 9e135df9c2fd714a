// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The few questions that every machine answers. Whatever satisfies this concept gets every analysis.
#pragma once

#include <ceres/jet.h>
#include <algorithm>

#include <concepts>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "polypod/core/interval.hpp"
#include "polypod/machine/common.hpp"

namespace polypod::kinematics {

using machine::ClosureVector;
using machine::ClosureVectorT;
using machine::JacobianMatrix;
using machine::JointKind;
using machine::JointVector;
using machine::JointVectorT;
using machine::Parameter;
using machine::Task;

/// Six derivatives at a time: one pass gives F_X, one pass each six columns of F_q or F_p.
using Dual = ceres::Jet<double, 6>;

/// A family of machines: a struct M and these free functions, found by argument-dependent lookup or in this namespace.
///
/// - `joint_count(m)`, `joint_kind(m, i)`, `joint_range(m, i)`: the joints that move.
/// - `task(m)`: what a pose prescribes.
/// - `parameters(m)`: the named geometric parameters p with their nominal values, SI.
/// - `closure(m, X_MT, q, p)`: the equations F(X, q, p) = 0, at least as many as unknowns of X (6), on any number type.
/// - `limits(m, X_MT, q, p)`: the values g(X, q, p), each >= 0 where the limit is kept, on any number type (at most
/// 64).
/// - `limit_name(m, i)`: what stops the machine where g_i < 0.
///
/// Families with several solutions of their inverse have `branch_name(m, branch)`; those whose solutions are asked for
/// often have `parameter_values(m)`, the values of `parameters(m)` without names.
/// Families of machine files say more of their limits by `limit_table(m)`: groups that can be switched off, scales,
/// which are given.
///
/// From these alone follow forward and inverse kinematics (Newton), both Jacobians, errors, compliance and violated
/// limits (closure.hpp). A family may add closed forms for speed and branches.
template <class M>
concept Machine = requires(const M& m, int i, const PoseT<double>& X, std::span<const double> q,
                           const PoseT<Dual>& X_dual, std::span<const Dual> q_dual, const PoseT<Interval>& X_interval,
                           std::span<const Interval> q_interval) {
  { joint_count(m) } -> std::convertible_to<int>;
  { joint_kind(m, i) } -> std::same_as<JointKind>;
  { joint_range(m, i) } -> std::same_as<machine::JointRange>;
  { task(m) } -> std::same_as<Task>;
  { parameters(m) } -> std::same_as<std::vector<Parameter>>;
  { closure(m, X, q, q) } -> std::same_as<ClosureVectorT<double>>;
  { closure(m, X_dual, q_dual, q_dual) } -> std::same_as<ClosureVectorT<Dual>>;
  { closure(m, X_interval, q_interval, q_interval) } -> std::same_as<ClosureVectorT<Interval>>;
  { limits(m, X, q, q) } -> std::same_as<std::vector<double>>;
  { limits(m, X_interval, q_interval, q_interval) } -> std::same_as<std::vector<Interval>>;
  { limit_name(m, i) } -> std::convertible_to<std::string>;
};

/// Violated limits, one bit each, in the order of `limits(m, ...)`.
using LimitBits = std::uint64_t;
/// A limit that is missed by less than this is kept, in its unit (m, rad or none): rounding of the inverse.
inline constexpr double kLimitSlack = 1e-10;

/// Branches that a numeric search numbers count from here: "numeric-1", ...
inline constexpr unsigned kNumericBranch = 1U << 16;

/// One solution of the inverse kinematics.
struct Solution {
  JointVector joints;        ///< rad or m
  unsigned branch = 0;       ///< `branch_name(m, branch)` says it in words, e.g. "front elbow-up"
  LimitBits violations = 0;  ///< limits that this solution breaks
  bool singular = false;     ///< the branch is not isolated here; a free joint was set to 0
};

/// All solutions that were found. An empty list means that the pose is out of reach (`reason` says why) or, if
/// `converged` is false, that the numeric search gave up.
struct InverseResult {
  std::vector<Solution> solutions;
  bool converged = true;
  std::string reason;

  /// Whether a solution breaks none of these limits.
  [[nodiscard]] bool keeps(LimitBits heeded) const {
    return std::any_of(solutions.begin(), solutions.end(),
                       [&](const Solution& s) { return (s.violations & heeded) == 0; });
  }
  /// The first solution without violations, or null.
  [[nodiscard]] const Solution* reachable() const {
    for (const Solution& s : solutions)
      if (s.violations == 0) return &s;
    return nullptr;
  }
};

/// Bit i is set where values[i] < 0.
template <class Values>
LimitBits violated(const Values& values) {
  LimitBits bits = 0;
  int i = 0;
  for (const auto& g : values) {
    if (g < 0.0) bits |= LimitBits{1} << i;
    ++i;
  }
  return bits;
}

}  // namespace polypod::kinematics
