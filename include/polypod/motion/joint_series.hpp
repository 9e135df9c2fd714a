// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How the drives of any machine move when its tool moves: position, speed, acceleration and jerk from the closure.
#pragma once

#include "polypod/core/series.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod::motion {

using machine::AnyMachine;
using machine::JointVector;

/// A pose that moves with a parameter (a length, or time).
using PoseSeries = PoseT<Series>;

/// The pose at s = 0.
Pose value_of(const PoseSeries& X);

/// exp([w(s)]x) of a rotation vector that is 0 at s = 0.
Matrix3<Series> rotation_series(const Vector3<Series>& w);

/// Position, and derivatives of three orders against the parameter.
struct JointSeries {
  JointVector q, first, second, third;  ///< rad or m
  PoseSeries X;                         ///< the whole pose, with what no pose prescribes
  /// False where the machine is singular: the derivatives are then infinite, or not one alone.
  bool regular = false;
  /// The smallest pivot of the linear system against the largest, or the least share of a leg's force that its drive
  /// bears (hexapods, deltas); 0 where the machine is singular.
  double pivot = 0;
};

/// The drives that keep F(X, q, p) = 0 while the tool keeps what the task prescribes of the target. With
///   F(X(s), q(s)) = 0,  T(X(s), target(s)) = 0
/// the coefficients of each order k of twist and joints solve a linear system whose matrix, [F_X F_q; T_X 0], is that
/// of the first order (A dX + B dq = 0 beside what is prescribed), and whose right-hand side is the coefficient of
/// order k that the lower orders alone leave, found by evaluating the closure on power series. `settled` is the whole
/// pose with the joints q at s = 0 (kinematics::settled). Exact to rounding times the condition of the system. Of
/// families whose closure is not written for series (those of a user's own, and what they are a stage of) the
/// coefficients are central differences of eighth order of exact first derivatives: to about 1e-10 of the largest
/// derivative. A machine with more joints than its task asks for moves by the shortest change of its joints at each
/// order. Chains solve for their joints alone, and legs that each follow the tool by themselves (hexapods, deltas) have
/// closed forms. Cost: 0.2 us (six struts, delta), 1.8 us (five joints of an arm): bench/motion_bench, drives/*.
JointSeries joint_series(const AnyMachine& machine, const PoseSeries& target, const Pose& settled,
                         const JointVector& q);

/// The same with differences, whatever the family: for tests.
JointSeries joint_series_by_differences(const AnyMachine& machine, const PoseSeries& target, const Pose& settled,
                                        const JointVector& q);

/// The pose of the joints q next to a pose that it nearly has: Newton's method on the closure from there (chains: their
/// forward kinematics). `near` itself where that does not converge.
Pose pose_near(const AnyMachine& machine, const JointVector& q, const Pose& near);

}  // namespace polypod::motion
