// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The matrix between the rates of the joints and of the tool, of one unit.
#pragma once

#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/closure_solver.hpp"

namespace polypod::kinematics {

/// S of kinematics::dexterity, which says what it is of which machine.
struct RateMatrix {
  ClosureMatrix S;
  double characteristic_length = 0;  ///< L, m
  double scale = 1;                  ///< det S over Dexterity::determinant
  bool serial = false;               ///< takes joint speeds to the tool's; fewer than the task has: all is singular
};
/// A `length` above 0 replaces L.
RateMatrix rate_matrix(const AnyMachine& machine, const Pose& X_MT, const JointVector& q, double length = 0);

/// Of its S. Where the machine has more joints than its task has coordinates, the determinant is the product of the
/// singular values of the matrix: of serial arms sqrt(det(J J^T)), the manipulability (Yoshikawa 1985), SI, without
/// sign; of parallel machines sqrt(det(S^T S)). Serial arms with fewer joints have none, 0.
Dexterity dexterity(const RateMatrix& rates);

}  // namespace polypod::kinematics
