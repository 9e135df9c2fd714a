// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How fast and how strong a tool is in each direction: ellipsoids of velocity and force.
#pragma once

#include <optional>

#include "polypod/kinematics/any_machine.hpp"

namespace polypod::quality {

/// Half axes, largest first, and their directions: unit columns in M, each with its largest part positive. An axis may
/// be 0 (no motion that way) or infinite (any force that way is borne by the frame).
struct Ellipsoid {
  Vec3 half_axes = Vec3::Zero();
  Mat3 directions = Mat3::Identity();
};

/// With J = [J_v; J_w] of the tool's tip, [v; w] = J dq/dt, and joint forces tau = J^T [f; m]:
struct Ellipsoids {
  Ellipsoid velocity;  ///< { J_v u : |u| <= 1 }: half axes are the singular values of J_v; m/s per unit of joint speed
  Ellipsoid rotation;  ///< { J_w u : |u| <= 1 }; rad/s per unit of joint speed
  Ellipsoid force;     ///< { f : |J_v^T f| <= 1 }: 1 / those of `velocity`, same directions; N per unit of joint force
  Ellipsoid moment;    ///< { m : |J_w^T m| <= 1 }: 1 / those of `rotation`; Nm per unit of joint force
};

/// Units of joint speed are m/s and rad/s, of joint force N and Nm; all joints count together, by the root of the sum
/// of their squares. `force` is without a moment at the tip, `velocity` whatever the tool turns meanwhile; so their
/// products along an axis are 1. Below 1e-12 of the largest half axis a half axis counts as 0. Empty where J is not
/// finite. Source: Yoshikawa (1985),
/// manipulability and its dual. Cost: 5 us.
std::optional<Ellipsoids> ellipsoids(const kinematics::JacobianMatrix& J);

/// The same at a pose. Empty too where a parallel machine's A = F_X loses rank (Singularity::control below 1e-9).
std::optional<Ellipsoids> ellipsoids(const kinematics::AnyMachine& machine, const Pose& X_MT,
                                     const kinematics::JointVector& q);

}  // namespace polypod::quality
