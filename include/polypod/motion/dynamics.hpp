// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Masses of a machine, and the forces that its drives need for a motion.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "polypod/core/config.hpp"
#include "polypod/core/units.hpp"
#include "polypod/motion/joint_series.hpp"

namespace polypod::motion {

/// A rigid body in a frame that its user names.
struct Body {
  double mass = 0;              ///< kg
  Vec3 center = Vec3::Zero();   ///< of mass, m
  Mat3 inertia = Mat3::Zero();  ///< about the center of mass, in the axes of the frame, kg m^2
  /// Whether a rigid body can have it: no principal moment is larger than the sum of the others. Measured ones may be.
  bool rigid = true;
};

/// What moves, as the table `dynamics` of a machine file says it. Parts that it does not name have no mass.
struct Dynamics {
  Vec3 gravity = Vec3(0, 0, -units::kStandardGravity);  ///< m/s^2, in M
  bool gravity_given = false;                           ///< else as the machine stands (kinematics::hangs_down)
  std::optional<Body> platform;            ///< or the tool of an arm: from the tool tip, in the axes of the tool frame
  std::optional<Body> payload;             ///< likewise
  std::vector<std::optional<Body>> links;  ///< of arms, one a row of the table, in the frame of that row
  /// Struts: the half at the base joint and the half at the platform joint, with the distance of their centers of mass
  /// from that joint along the strut, and their inertia across it.
  double strut_fixed = 0, strut_fixed_center = 0, strut_fixed_inertia = 0;
  double strut_moving = 0, strut_moving_center = 0, strut_moving_inertia = 0;
  double rod = 0;     ///< kg, of a uniform rod of constant length (both of a parallelogram together)
  double slider = 0;  ///< kg
  double arm = 0, arm_center = 0, arm_inertia = 0;  ///< kg, m from the drive's axis, kg m^2 about that axis
  std::vector<double> drive;     ///< what turns or slides with each drive: kg m^2 or kg; empty, one, or one a drive
  std::vector<double> friction;  ///< N or Nm, against the motion; empty, one, or one a drive
  std::vector<double> viscous;   ///< N s/m or Nm s/rad; likewise
  std::vector<Dynamics> stages;  ///< of machines in series: the bodies of each, from the base; none of the rest
  bool of_stages = false;        ///< the masses of the stages are those of their own files
  /// What of these does not count, because the whole or the next stage stands for it: "stage 1 payload".
  std::vector<std::string> left_out;
  /// Stages, from 1, whose own files have masses that the table of the whole stands for.
  std::vector<int> not_read;

  /// The keys of the parts that have a mass or an inertia.
  [[nodiscard]] std::vector<std::string> parts_with_mass() const;
  /// The bodies with an inertia that no rigid body has: "link 3".
  [[nodiscard]] std::vector<std::string> not_rigid() const;
};

/// The table `dynamics` of the TOML file at this path; nothing where the file has none (or is a URDF file). Of a
/// machine in series whose table has no `[[dynamics.stage]]` the masses and the drives' numbers of the stages' own
/// files count; the gravity is that of the whole, and what a stage carries is the next one and not its own payload.
/// Errors: those of config, MO120 (an inertia that no body has: a negative principal moment, or one larger than 1.25
/// times the sum of the others), MO121 (a key that the machine has no part for), MO122 (as many numbers as drives,
/// links as rows, stages as the machine has).
Result<std::optional<Dynamics>> read_dynamics(const std::string& path, const AnyMachine& machine);

/// The table `dynamics` as text in the units of docs/motion.md (kg, mm, kg m2, N, Nm), which reads back as it is.
std::string to_toml(const Dynamics& dynamics, std::optional<double> damping_ratio = {});

/// Why the forces of this machine's drives are not computed; empty where they are: families of a user's own (as a
/// stage too), and machines with more drives than their task has coordinates (their drives strain each other).
std::string no_dynamics(const AnyMachine& machine);

/// The forces (N) and torques (Nm) of the drives, positive where they push towards larger q, by virtual work:
///   tau_j = sum_k dv_k/dq_j . f_k + I_j q_j'' + friction,  f_k = sum_l G_kl v_l'' - w_k g,
/// over the vectors v_k(X, q) that masses hang on: origin and axes of a body, ends and direction of a line, with the
/// masses G by pairs of them and w by their weight. dv_k/dq_j follows the closure (the twist of the tool is J_j), and
/// v_k'' is that of the power series of the motion. `motion`: against time. Exact to rounding. Cost: 1 us with the
/// masses of every leg, 1.7 us with those of five links (bench/motion_bench, forces/*).
JointVector drive_forces(const AnyMachine& machine, const Dynamics& dynamics, const JointSeries& motion);

/// M(q) of T = 1/2 q'^T M q', at a pose that the machine has.
Eigen::MatrixXd mass_matrix(const AnyMachine& machine, const Dynamics& dynamics, const Pose& X, const JointVector& q);

/// Kinetic and potential energy (0 at the origin of M), J.
struct Energy {
  double kinetic = 0, potential = 0;
};
Energy energy_of(const AnyMachine& machine, const Dynamics& dynamics, const JointSeries& motion);

/// Frequencies of the machine on the compliances of its elements (kinematics::elements) with its drives locked, Hz,
/// rising: (K - w^2 M) x = 0 with K the inverse of the compliances and M by what the elements move. What turns with a
/// drive takes no part. Empty where the machine has no compliances or no masses.
std::vector<double> natural_frequencies(const AnyMachine& machine, const Dynamics& dynamics, const Pose& X,
                                        const JointVector& q);

/// The twist of the tool (m, rad, in M) by the weight of what moves, its drives held at q and its elements yielding
/// (kinematics::elements): for the compliances c_e, the twist J_e of the tool and the way dv_k/dx_e of what weighs w_k
/// (drive_forces),
///   sum_e J_e c_e sum_k w_k dv_k/dx_e . g.
/// What hangs on locked joints pulls at the drives alone. In first order: the change of the weights' levers by the
/// deflection is left out. Zero where the machine has no compliances or no masses. Cost: as natural_frequencies.
Vec6 weight_twist(const AnyMachine& machine, const Dynamics& dynamics, const Pose& X, const JointVector& q);

}  // namespace polypod::motion
