// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What deflects on a delta, how far it reaches, how it looks.
#pragma once

#include "polypod/families/delta/kinematics.hpp"
#include "polypod/machine/parts.hpp"

namespace polypod::machine {

/// Each drive, then each parallelogram.
std::vector<Element> elements(const RotaryDelta& m);
std::vector<Element> elements(const LinearDelta& m);
/// Chain i deflects by B_i dq_i + dc_i along its rods, A dX is what all chains deflect. With four chains the loads
/// share out as their stiffnesses K: dX is then (A^T K A)^-1 A^T K times what the chains would deflect alone, and
/// sum c_i J_i J_i^T = (A^T K A)^-1.
ElementColumns element_columns(const RotaryDelta& m, const JointVector& q, const Pose* X_MT);
ElementColumns element_columns(const LinearDelta& m, const JointVector& q, const Pose* X_MT);
void set_compliance(Delta& m, int element, double compliance);

/// Round home: no chain reaches farther than arm (or rail) and rod.
Reach reach(const RotaryDelta& m);
Reach reach(const LinearDelta& m);
/// The tool tip at home.
Vec3 middle_of_work(const Delta& m);

/// z of a delta grows downwards (KOZ 4.2.1).
constexpr bool hangs_down(const Delta&) {
  return true;
}

/// At home: base, arms or rails, the two rods of each parallelogram, platform and tool.
Outline outline(const RotaryDelta& m, const Vec3& tip);
Outline outline(const LinearDelta& m, const Vec3& tip);
Outline outline_at(const RotaryDelta& m, const Pose& X_MT, const JointVector& q);
Outline outline_at(const LinearDelta& m, const Pose& X_MT, const JointVector& q);

}  // namespace polypod::machine
