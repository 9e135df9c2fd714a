// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What deflects on a hexapod, how far it reaches, how it looks.
#pragma once

#include <array>
#include <optional>

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
Outline outline_at(const StrutHexapod& m, const Pose& X_MT, const JointVector& q);
Outline outline_at(const SliderHexapod& m, const Pose& X_MT, const JointVector& q);

/// The joints that the legs take at a pose whatever limits they break: strut lengths; of sliders the root of the outer
/// end where it lies on its rail. Nothing where a leg does not reach its rail.
std::optional<JointVector> joints_of_legs(const StrutHexapod& m, const Pose& X_MT);
std::optional<JointVector> joints_of_legs(const SliderHexapod& m, const Pose& X_MT);

/// Six legs between anchors and platform joints, for loops over many poses.
struct LegLayout {
  bool rails = false;
  std::array<Vec3, kLegs> anchor;           ///< base joints, or the outer ends of the rails
  std::array<Vec3, kLegs> rail;             ///< unit directions
  std::array<double, kLegs> rail_length{};  ///< m
  std::array<double, kLegs> leg_length{};   ///< of slider legs, m
  std::array<Vec3, kLegs> end;              ///< platform joints in T
};
LegLayout leg_layout(const StrutHexapod& m);
LegLayout leg_layout(const SliderHexapod& m);

}  // namespace polypod::machine
