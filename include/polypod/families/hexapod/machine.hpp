// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What strut and slider hexapods have in common: six legs, two platforms, joints that allow some directions.
#pragma once

#include <array>
#include <optional>

#include "polypod/machine/common.hpp"

namespace polypod::machine {

inline constexpr int kLegs = 6;
using SixPoints = std::array<Vec3, kLegs>;
using SixNumbers = std::array<double, kLegs>;

/// Six joints on a circle round z in three close pairs (JEL (3.1), (3.2), Figure 3.6).
struct PairedCircle {
  double radius = 0;      ///< m, > 0
  double pair_angle = 0;  ///< rad, the smaller angle between two neighbours, 0..120 deg; 0 joins them (double joints)
};

/// The joints of the fixed platform: pairs (6,1), (2,3), (4,5) about 0, 120, 240 deg (JEL (3.1), alpha_0 = 0).
SixPoints base_pairs(const PairedCircle& circle);
/// The joints of the moving platform: pairs (1,2), (3,4), (5,6) about 60, 180, 300 deg, so that the bisector of a small
/// angle of one platform meets that of a large angle of the other (JEL (3.2)).
SixPoints platform_pairs(const PairedCircle& circle);

/// Which directions of a leg its two joints allow.
enum class JointLimitKind {
  none,
  cone,       ///< at most `angle` from the leg's direction at home (JEL (4.6), (4.8))
  elevation,  ///< the angle between leg and platform normal differs from that at home by at most `angle`
  pyramid,    ///< inside a four-sided pyramid about the direction at home (JEL (4.9))
};

struct JointLimit {
  JointLimitKind kind = JointLimitKind::none;
  double angle = 0;         ///< rad, 0 < angle < pi (pyramid: half angle about the radial axis, < pi/2)
  double angle_across = 0;  ///< rad, pyramid only: the other half angle
};

/// The seats of the six joints of one end, where they differ from the common cone: each holds its leg within `angle` of
/// `axis`, the direction from the base joint to the platform joint, in M at the base and in P at the platform.
struct JointSeats {
  std::optional<SixPoints> axis;    ///< unit vectors; empty: the legs' directions at home
  std::optional<SixNumbers> angle;  ///< rad, above 0 and at most pi; empty: JointLimit::angle
};

/// The legs at the home pose: platform parallel to the base over its origin. Joint limits are centred there.
struct HexapodHome {
  std::optional<double> height_given;  ///< m, of the platform's origin; empty: by the family's rule
  double height = 0;                   ///< m, given or found
  SixPoints direction{};               ///< unit vectors along the legs, from base to platform (in M and in P)
};

/// The four inward normals of leg i's pyramid about its home direction s: side planes through the joint whose half
/// angles are `angle` (in the plane of s and the tangential axis z x s) and `angle_across`; a direction w is inside
/// where w . n >= 0 for all four. Where s is parallel to z the tangential axis is y.
std::array<Vec3, 4> pyramid_normals(const Vec3& s, const JointLimit& limit);

}  // namespace polypod::machine
