// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The closed inverse of industrial robots: six joints, the last three of which meet in one point.
#pragma once

#include <array>
#include <optional>

#include "polypod/families/serial/machine.hpp"
#include "polypod/kinematics/concept.hpp"

namespace polypod::machine {

/// All branches of a closed inverse with six joints, on the stack.
struct SixJointBranches {
  static constexpr int kCount = 8;
  double joints[kCount][6];  ///< rad; only where `exists`
  bool exists[kCount];       ///< the target is within reach on this branch
  bool singular[kCount];
};

/// Inverse kinematics of arms with six free turning joints (and any locked ones) whose axes 4, 5 and 6 meet in the
/// wrist centre W, whose axes 2 and 3 are parallel, and whose axis 1 is square to them: nearly all industrial robots
/// with six joints, with any offsets (Brandstoetter, Angerer, Hofbaur 2014 call this the ortho-parallel basis with a
/// spherical wrist, with the lengths a1, a2, b, c1 .. c4). Any table, standard or modified, any senses and zeros, base
/// and tool: the axes of the arm in its zero position are all that counts.
///
/// In a frame with z along axis 1, y along axis 2 and its origin beside axis 2:
/// - W = Rz(t1) (rho, b, z) with b, by which W stands off the plane of axis 1, constant: rho = +-sqrt(x^2 + y^2 - b^2);
/// - in the plane, from axis 2 at (a1, 0): W = (upper + fore e^(i g)) e^(i t2), with g = +-acos(law of cosines);
/// - M = (R_1 R_2 R_3)^T R = Rz(t4) Ry(t5) Rz(t6) for a right-angled wrist (4 square to 5 square to 6), two sets of
///   Euler angles. For other twists t5 follows from the spherical triangle of axes 4, 5 and 6.
/// Complex numbers stand for the angles until the end, so that no angle is taken twice.
///
/// Eight branches `front|back elbow-up|elbow-down [wrist-flipped]` in this order (docs/machine-files.md):
/// - front: W on the side of axis 1 on which axis 2 stands (axis 2 through axis 1: on which W stands at joints 0);
/// - elbow-up: the elbow above the line from axis 2 to W, seen with the wrist to the right (over the back: to the left)
///   and axis 1 up (away from the base);
/// - flipped: joint 5 below its straight position: 0 where axes 4 and 6 are in line at joint value 0 (as with all
///   makers), else the position in which they point the same way.
///
/// Singular, and marked so:
/// - W on axis 1: joint 1 is that of the reference, or 0; front and back are half a turn apart;
/// - W on axis 2 (links of equal length, folded): likewise joint 2;
/// - axes 4 and 6 in line: likewise joint 4; joint 6 does the rest;
/// - the arm stretched or folded (both elbows are one), W as near to axis 1 as b allows (front and back are one).
/// The first three count within 1e-12 (m, rad). Farther off the angles follow from the pose alone, and the pose follows
/// from them to rounding, however near: joints 4 and 6 are taken together. What is free near a singular pose is thus
/// not damped: along a path that passes a straight wrist at a distance, joints 4 and 6 turn as fast as the path asks.
class SphericalWristInverse {
 public:
  using Branches = SixJointBranches;

  /// Nothing if the arm has no such form.
  static std::optional<SphericalWristInverse> of(const SerialArm& arm);

  /// All branches of the pose X_MT, each joint in the turn within its range if there is one, else in (-pi, pi]. With a
  /// `reference` (six values): of several turns within the range the nearest to it. No allocation. Cost: as
  /// WristInverse, `kinematics_bench --benchmark_filter='polypod_inverse|spherical_wrist'`.
  void solve(const Pose& X_MT, Branches& out, const double* reference = nullptr) const;
  /// The same with limits, as a list.
  [[nodiscard]] kinematics::InverseResult solve(const Pose& X_MT, const double* reference = nullptr) const;

  /// Two bits a joint, in the order of `limits`.
  [[nodiscard]] kinematics::LimitBits violations(const double* joints) const;

  /// The figures that `solve` works with, for bounds over boxes of poses. Lengths in m, angles in rad.
  struct Form {
    std::array<JointRange, 6> range;
    std::array<double, 6> sense;            ///< of joints 1 to 3 against z, and against the turn from x to z
    Mat3 R_AM;                              ///< the arm's frame A: x to the front, z up along axis 1
    Vec3 p_AM, wrist_T;                     ///< W in the tool frame
    Mat3 tool, lead;                        ///< M = lead^T (R_1 R_2 R_3)^T R_AM R tool
    double a1, b, upper, fore;              ///< links in the arm's plane
    std::array<double, 2> upper_0, fore_0;  ///< their directions (x, z) at joints 0
    double bend, middle;                    ///< the angle from upper to fore there; joint 5 where axes 4 and 6 align
  };
  /// Nothing where the wrist is not right-angled.
  [[nodiscard]] std::optional<Form> form() const;

 private:
  std::array<JointRange, 6> range_;
  std::array<double, 6> sense_{};  ///< +1 or -1: of joints 1 to 3 against z, and against the turn from x to z
  Mat3 R_AM_;                      ///< the arm's frame A: x to the front, z up along axis 1
  Vec3 p_AM_;
  Vec3 wrist_T_;           ///< W in the tool frame
  Mat3 tool_;              ///< R_TM at joints 0, with the axes of the last joint: M = lead^T R_A N, N = R_AM R tool
  Mat3 lead_;              ///< of the axes at joints 0 in A: [w5 x w4, w5, w4] if right-angled, else [w4, w5, w6]
  double a1_ = 0, b_ = 0;  ///< m
  double upper_ = 0, fore_ = 0;                                 ///< lengths of the links in the plane, m
  double upper_c_ = 1, upper_s_ = 0, fore_c_ = 1, fore_s_ = 0;  ///< their directions (x, z) at joints 0
  double bend_ = 0;                                             ///< the angle from upper to fore there
  double middle_ = 0;         ///< joint 5 where axes 4 and 6 point the same way (right-angled: in line)
  bool swapped_ = false;      ///< joint 5 is straight at 0 with axes 4 and 6 against each other
  bool right_angled_ = true;  ///< axes 4 and 5, and 5 and 6, are square to each other
};

}  // namespace polypod::machine
