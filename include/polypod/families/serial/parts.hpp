// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What deflects on a serial arm, how far it reaches, how it looks.
#pragma once

#include "polypod/families/serial/kinematics.hpp"
#include "polypod/machine/parts.hpp"

namespace polypod::machine {

/// Every row of the table: a brake is compliant too.
std::vector<Element> elements(const SerialArm& arm);
ElementColumns element_columns(const SerialArm& arm, const JointVector& q, const Pose* X_MT);
void set_compliance(SerialArm& arm, int element, double compliance);

/// Round its base, by the lengths of all links.
Reach reach(const SerialArm& arm);
/// The origin of M, which the file puts where the work is.
Vec3 middle_of_work(const SerialArm& arm);

/// The origins of the frames of the table with the tool at zero tilt at `tip`; nothing but the axes of the base if that
/// is out of reach.
Outline outline(const SerialArm& arm, const Vec3& tip);
/// The same at the joints q, whose pose is X_MT.
Outline outline_at(const SerialArm& arm, const Pose& X_MT, const JointVector& q);

}  // namespace polypod::machine
