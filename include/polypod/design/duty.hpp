// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the machines of a study shall carry and do: poses, a load, masses, and a motion. Figures on forces, stiffness
// and times ask for it.
#pragma once

#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "polypod/core/config.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/motion/cycles.hpp"
#include "polypod/motion/dynamics.hpp"
#include "polypod/motion/pose_path.hpp"

namespace polypod::design {

using machine::AnyMachine;
using machine::JointVector;

/// The keys `poses`, `load_N`, `load_moment_Nm`, `direction`, [dynamics], [move] and [pick] of a study file.
struct Duty {
  std::vector<Pose> poses;                 ///< of the tool tip in M; empty: the points of the workspace
  std::optional<Vec6> load;                ///< on the tool at its tip, [N; Nm] in M
  std::optional<Vec3> direction;           ///< in M, of length 1; nothing: the softest one at each pose
  std::optional<motion::Dynamics> masses;  ///< the same for every candidate
  std::optional<motion::PosePath> path;    ///< of [move]
  std::optional<motion::Cycle> pick;       ///< of [pick]
  /// Of [move] and [pick]: the tool's, and those of drives that turn (rad) and that slide (m).
  motion::Peaks tool{5, 100, 5000}, turning{12, 250, 20000}, sliding{12, 250, 20000};
  std::string identity;  ///< everything of the above as text
};

/// What a study with poses or a motion holds, in words.
inline constexpr const char* kAllPoses = "every pose of the study is reached";
inline constexpr const char* kMotion = "the machine passes the whole motion of the study";

/// Reads them. Errors: OP140 (poses, a direction or a motion that say nothing), those of motion and config.
Result<Duty> read_duty(const config::Table& study, const AnyMachine& machine);
/// The text of these tables and keys with their values alone, whatever their order, comments and blanks.
std::string canonical(const config::Table& table);

/// What a machine shows at one pose.
struct AtPose {
  double frequency = std::numeric_limits<double>::infinity();  ///< Hz, the lowest
  double force = 0, torque = 0;                                ///< N, Nm: the largest of drives that slide, that turn
  double stiffness = std::numeric_limits<double>::infinity();  ///< N/m
  double deflection = 0;                                       ///< m
  double leg = 0;                                              ///< m
};

/// What of it is wanted.
struct AtPoseWanted {
  bool frequency = false, force = false, stiffness = false, deflection = false, leg = false;
};

/// The figures at a pose, in the first joints that keep all limits.
///
/// frequency: the lowest of motion::natural_frequencies. force, torque: of the drives at rest under the load and the
/// weight of the masses, tau = -J^T w + tau_g by virtual work. stiffness along the unit vector d: a force along d over
/// what the tip moves along d, 1 / (d^T C d), C of statics::compliance_at; without a direction 1 / the largest
/// eigenvalue of C. deflection: |C w| of the tip under the load. leg: the longest leg between its joints (a strut, a
/// rod of constant length, an arm and its rod one after the other). Infinite where the machine is singular. Errors:
/// OP142 (a pose that the machine does not reach within its limits; the message says which limit).
Result<AtPose> at_pose(const AnyMachine& machine, const Duty& duty, const AtPoseWanted& wanted, const Pose& X_MT);

/// Why the machine has no such figure, whatever its parameters; empty where it has.
std::string no_frequency(const AnyMachine& machine, const Duty& duty);
std::string no_drive_force(const AnyMachine& machine, const Duty& duty, machine::JointKind kind);
std::string no_leg(const AnyMachine& machine);
std::string no_cycle_time(const AnyMachine& machine, const Duty& duty);

/// The time of the motion, s, or how far it can be passed.
struct CycleTime {
  double seconds = 0;
  std::string broken;  ///< the first thing that does not let the machine pass; empty where it passes
  double passed = 1;   ///< share of the path
};
/// [move]: as `polypod move --time-optimal` with these limits finds it; [pick]: one way of the cycle, as `polypod pick`
/// does. Errors: those of motion that no other candidate could avoid.
Result<CycleTime> cycle_time(const AnyMachine& machine, const Duty& duty);

}  // namespace polypod::design
