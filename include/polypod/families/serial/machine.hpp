// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Serial arms: a Denavit-Hartenberg table and what stands round it.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/core/config.hpp"
#include "polypod/machine/common.hpp"

namespace polypod::machine {

/// standard: A_i = Rot(z, theta) Trans(z, d) Trans(x, a) Rot(x, alpha) (SLAV (2.13));
/// modified (Craig): A_i = Rot(x, alpha) Trans(x, a) Rot(z, theta) Trans(z, d).
enum class DhConvention { standard, modified };

/// One row of the table. The angle is theta = sign q + theta_offset + coupling q_c (revolute) or the distance d + sign
/// q (prismatic); q_c is the joint of an earlier turning row whose motion turns this one too, as where a drive counts
/// from the base (a parallelogram, joint 3 of many arms).
struct DhRow {
  double a = 0;             ///< m
  double alpha = 0;         ///< rad
  double d = 0;             ///< m
  double theta_offset = 0;  ///< rad
  double sign = 1;          ///< +1 or -1: the direction in which the joint counts
  JointKind kind = JointKind::revolute;
  std::optional<double> locked;  ///< the value of a joint that does not move, rad or m
  JointRange range{};            ///< of q; unused where locked
  double speed = 0;              ///< the fastest that the joint goes, rad/s or m/s; 0: not said
  double compliance = 0;         ///< rad/Nm (revolute) or m/N (prismatic); also of a locked joint (its brake)
  int coupled_back = 0;          ///< how many rows before this one that row is; 0: none
  double coupling = 0;
};

/// A serial arm: X_MT(q) = X_MB A_1(q_1) ... A_n(q_n) X_FT.
struct SerialArm {
  static constexpr std::string_view kFamily = "serial";
  /// A pose may be taken in any posture that keeps the limits; a parallel machine keeps to its own.
  static constexpr bool kAnyPosture = true;

  std::string name;
  std::string description;
  DhConvention convention = DhConvention::standard;
  std::vector<DhRow> dh;
  Pose X_MB;  ///< base in the machine's reference frame M
  Pose X_FT;  ///< tool tip in the last frame of the table; z_T is the tool axis, from the tip to the spindle
  Task task = Task::pose;
  Provenance provenance;

  /// Number of joints that move.
  [[nodiscard]] int free_joints() const;
  /// Whether a joint turns another one too.
  [[nodiscard]] bool is_coupled() const;
  /// What a pose prescribes where nothing says: all six coordinates from six free joints on, the tip and the tool axis
  /// with five, the tip with fewer.
  [[nodiscard]] Task usual_task() const;

  /// Reads the keys of a serial arm (docs/machine-files.md) and finishes the table.
  static Result<SerialArm> from(const config::Table& table);
};

/// The parameters of the kinematics, 4 a row: dh[i].a, dh[i].alpha, dh[i].d, dh[i].theta_offset (i from 1).
std::vector<Parameter> parameters(const SerialArm& arm);
/// Their values alone.
std::vector<double> parameter_values(const SerialArm& arm);

/// The fastest that a joint goes, rad/s or m/s; 0: not said (kinematics::speed_limits).
double joint_speed_limit(const SerialArm& arm, int joint);

/// The arm with other values of its parameters, in the order of `parameters`.
Result<SerialArm> with_parameters(const SerialArm& arm, std::span<const double> p);

/// Writes the arm as a machine file that reads back to the same arm.
std::string to_toml(const SerialArm& arm);

}  // namespace polypod::machine
