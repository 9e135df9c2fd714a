// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What gives way on a hexapod, how far it reaches, how it looks.
#pragma once

#include "polypod/families/hexapod/slider_kinematics.hpp"
#include "polypod/families/hexapod/strut_kinematics.hpp"
#include "polypod/machine/parts.hpp"

namespace polypod::machine {

/// The six legs, each with the compliance of its strut or slider; the columns are those of the Jacobian.
std::vector<Element> elements(const StrutHexapod& m);
std::vector<Element> elements(const SliderHexapod& m);
ElementColumns element_columns(const StrutHexapod& m, const JointVector& q, const Pose* X_MT);
ElementColumns element_columns(const SliderHexapod& m, const JointVector& q, const Pose* X_MT);
void set_compliance(StrutHexapod& m, int element, double compliance);
void set_compliance(SliderHexapod& m, int element, double compliance);

/// Round the feet of the legs: a leg, then the way from its joint on the platform to the tip.
Reach reach(const StrutHexapod& m);
Reach reach(const SliderHexapod& m);
/// The tool tip at home.
Vec3 middle_of_work(const StrutHexapod& m);
Vec3 middle_of_work(const SliderHexapod& m);

/// At home: base or rails, legs, platform and tool.
Outline outline(const StrutHexapod& m, const Vec3& tip);
Outline outline(const SliderHexapod& m, const Vec3& tip);

}  // namespace polypod::machine
