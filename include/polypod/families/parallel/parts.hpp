// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What deflects on a machine of legs, how far it reaches, how it looks.
#pragma once

#include "polypod/families/parallel/kinematics.hpp"
#include "polypod/machine/parts.hpp"

namespace polypod::machine {

/// Each leg, driven or not; its column is what the tool does where it becomes longer.
std::vector<Element> elements(const Parallel& m);
ElementColumns element_columns(const Parallel& m, const JointVector& q, const Pose* X_MT);
void set_compliance(Parallel& m, int element, double compliance);

/// Round what the legs are fixed to: the path of the drive, the leg, and from its end to the tip.
Reach reach(const Parallel& m);
/// The tool tip at home.
Vec3 middle_of_work(const Parallel& m);

inline bool hangs_down(const Parallel& m) {
  return m.hangs;
}

/// At home: what drives the legs, the legs, the platform joints to the tool tip.
Outline outline(const Parallel& m, const Vec3& tip);
Outline outline_at(const Parallel& m, const Pose& X_MT, const JointVector& q);

}  // namespace polypod::machine
