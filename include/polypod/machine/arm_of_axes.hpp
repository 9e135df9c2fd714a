// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A serial arm from where its axes lie, as other formats than a Denavit-Hartenberg table give them.
#pragma once

#include <cstddef>
#include <optional>
#include <span>

#include "polypod/core/error.hpp"
#include "polypod/families/serial/machine.hpp"

namespace polypod::machine {

/// A joint by its axis where all joints are 0.
struct JointAxis {
  Vec3 direction = Vec3::UnitZ();  ///< unit vector in M: a positive joint turns about it, or moves along it
  Vec3 point = Vec3::Zero();       ///< a point of the axis in M, m; of a prismatic joint any point will do
  JointKind kind = JointKind::revolute;
  JointRange range{};  ///< rad or m
  double speed = 0;    ///< the fastest, rad/s or m/s; 0: not said
  /// No drive of its own: it turns by `multiplier` times the joint of that earlier axis, which turns too, and `offset`.
  std::optional<std::size_t> follows;
  double multiplier = 1;
  double offset = 0;  ///< rad
};

/// The arm X_MT(q) = exp(xi_1 q_1) ... exp(xi_n q_n) X_MT(0), xi_i the twist of axis i, as a standard table with base
/// and tool. Each row leads along the common normal of two axes. {F}, the last frame, lies on the last axis: its origin
/// is the foot of that of `X_MF` on that axis, x_F points as x of `X_MF` does as far as z lets it, and z_F is the axis,
/// in the sense in which it is nearer to z of X_MF; X_FT takes the rest. So where the last axis is the z axis of X_MF,
/// F is X_MF.
///
/// @param axes   in the order of the chain, 1 to kMaxJoints; one that follows another becomes a locked row with a
/// coupling
/// @param X_MT   the tool tip where all joints are 0, in M
/// @param X_MF   what the last frame is to be, as far as it lies on its axis, see above: the flange
/// @return the arm with its task left as it is by default; a frame of the base that lies on the first axis, next to the
///   origin of M and as near to its directions as the axis lets it.
///
/// Rounding: some 1e-15 of the arm's size. Two axes that are parallel to less than 1e-13 rad are taken as parallel. Two
/// that are nearly so (below 1e-3 rad) have their common normal far off, where it would cost digits: a locked row
/// across both stands between their rows. Errors: MA191 (no joint, or more rows than kMaxJoints). Source: Denavit and
/// Hartenberg (1955) in the form of SLAV (2.13).
Result<SerialArm> arm_of_axes(std::span<const JointAxis> axes, const Pose& X_MT, const Pose& X_MF);

}  // namespace polypod::machine
