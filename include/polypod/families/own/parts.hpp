// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What deflects on a machine of a family of one's own, how far it reaches, how it looks.
#pragma once

#include "polypod/families/own/kinematics.hpp"
#include "polypod/machine/parts.hpp"

namespace polypod::machine {

/// The drives, "joint 1", ...; their columns are those of the Jacobian.
std::vector<Element> elements(const Own& m);
ElementColumns element_columns(const Own& m, const JointVector& q, const Pose* X_MT);
void set_compliance(Own& m, int element, double compliance);

/// The family's own, else the box of the tool tip at 512 places of the joints inside their ranges, half as wide again:
/// a sample.
Reach reach(const Own& m);
/// The tool tip at home.
Vec3 middle_of_work(const Own& m);
/// The family's own, else a line from the origin of M to the tool tip.
Outline outline(const Own& m, const Vec3& tip);
Outline outline_at(const Own& m, const Pose& X_MT, const JointVector& q);

}  // namespace polypod::machine
