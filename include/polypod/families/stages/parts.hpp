// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What deflects on machines in series, how far they reach, how they look: what their stages say, carried along.
#pragma once

#include "polypod/families/stages/kinematics.hpp"
#include "polypod/machine/parts.hpp"

namespace polypod::machine {

/// Those of every stage, "stage 1 leg 2"; their columns carried to the tool tip.
std::vector<Element> elements(const Stages& m);
ElementColumns element_columns(const Stages& m, const JointVector& q, const Pose* X_MT);
void set_compliance(Stages& m, int element, double compliance);

/// Round the base of the first stage: no stage's tool is farther from its own base than the farthest corner.
Reach reach(const Stages& m);
/// The tool tip at home.
Vec3 middle_of_work(const Stages& m);

/// As the stage with closed loops does in its own frame, where what carries it at home leaves that within 45 deg.
bool hangs_down(const Stages& m);

/// Every stage at home, where the stages before it put it.
Outline outline(const Stages& m, const Vec3& tip);
Outline outline_at(const Stages& m, const Pose& X_MT, const JointVector& q);

}  // namespace polypod::machine
