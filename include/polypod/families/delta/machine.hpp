// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What deltas with arms and deltas with rails have in common: three or four chains that end in parallelograms of rods.
#pragma once

#include <array>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "polypod/machine/common.hpp"

namespace polypod::machine {

/// Chains of a delta; four are driven redundantly.
inline constexpr int kMaxArms = 4;
template <class T>
using PerArm = std::array<T, kMaxArms>;

/// Which directions of a rod its two ball joints allow.
struct RodJoint {
  double side = std::numbers::pi / 2;   ///< rad, out of the plane of its arm at most; the parallelogram leans as much
  double elbow_min = 0;                 ///< rad, between the prolonged arm (or the rail) and the rod at least
  double elbow_max = std::numbers::pi;  ///< and at most
  double platform = std::numbers::pi / 2;  ///< rad, between the rod and z at most; 90 deg: elbow above platform joint
};

/// What a delta may run into. A thickness of 0 switches that part off.
struct DeltaBodies {
  double rod_diameter = 0;        ///< m
  double rod_spacing = 0;         ///< m, between the two rods of a parallelogram
  double arm_diameter = 0;        ///< m, of arms or rails
  double base_thickness = 0;      ///< m, of the edges of the base from base joint to base joint
  std::optional<double> table_z;  ///< m, the table: elbows and platform joints stay above it (smaller z)
};

/// Chains i = 0 .. arms - 1 hold the platform by |X + P_i - tool - S_i(q_i)| = c_i at R = 1, S_i the end that is
/// driven: the elbow of an arm or a carriage on a rail. {M}: z from the base to the platform (KOZ 4.2.1). X is the tool
/// tip.
struct Delta : TipLimits {
  std::string name;
  std::string description;
  int arms = 3;
  PerArm<double> direction{};     ///< rad, azimuth of the outward direction of the chain's plane
  PerArm<Vec3> outward{};         ///< (cos, sin, 0) of it
  PerArm<Vec3> axis{};            ///< (-sin, cos, 0): of the drive and of the parallelogram's short sides
  PerArm<double> rod_length{};    ///< c_i, m
  PerArm<Vec3> platform_joint{};  ///< P_i in P, m
  Vec3 tool = Vec3::Zero();       ///< tool tip in P, m
  JointRange range;               ///< of every drive, rad or m
  RodJoint joint;
  DeltaBodies bodies;
  PerArm<double> drive_compliance{};  ///< rad/Nm or m/N of each drive, the bending of its arm (or rail) in it
  PerArm<double> rod_compliance{};    ///< m/N of each parallelogram along its rods
  Provenance provenance;

  double mode_sign = 1;      ///< sign of the assembly mode's volume at home, see DeltaLimits::kMode
  double home_joint = 0;     ///< all drives at home, rad or m
  Vec3 home = Vec3::Zero();  ///< X there, m
};

/// How a symmetric delta was given: circles of the joints, chains at first + 360 deg i / arms.
struct SymmetricDelta {
  double base_radius = 0;      ///< m
  double platform_radius = 0;  ///< m
  double first = 0;            ///< rad
};

/// Gruebler's count of a delta (KOZ (4.1)): F = 6 (n' - g - 1) + sum f - f_id + s'. Base, platform and for each chain
/// an arm or carriage and two rods; each chain has one driven joint and four ball joints, each rod turns idly about
/// itself, and every chain beyond three is passive. (4.1) is printed with n and means n'.
struct Mobility {
  int members = 0, joints = 0, freedoms = 0, idle = 0, passive = 0;
  int degrees = 0;
};
Mobility mobility(const Delta& m);

}  // namespace polypod::machine
