// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A job: all that is needed besides the program to say what a machine will do with it.
#pragma once

#include <algorithm>
#include <array>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/cutting/cutter.hpp"
#include "polypod/cutting/stock.hpp"
#include "polypod/gcode/interpreter.hpp"
#include "polypod/machine/any_machine.hpp"
#include "polypod/machining/path_mode.hpp"
#include "polypod/machining/tool_frame.hpp"
#include "polypod/statics/measured_map.hpp"

namespace polypod::motion {
struct Dynamics;
}

namespace polypod::machining {

/// A compliance that was measured near the work, and the files that it comes from.
struct MeasuredCompliance {
  std::vector<std::string> files;
  statics::MeasuredMap map;
  std::vector<Error> doubts = {};                ///< statics::Judgement::doubts: why no yes can rest on it
  std::vector<std::string> unused_columns = {};  ///< of the files
  std::size_t left_out = 0;                      ///< points of partial tests, which make no map
};

/// The controller that runs the program: what LinuxCNC's planner does between the blocks.
struct Controller {
  PlannerLimits planner;
  double shortest_length = 0;                ///< m, no block that Polypod writes is shorter ...
  double shortest_time = 0;                  ///< s, ... nor takes less time; 0: two servo periods
  std::map<int, gcode::MCode> m_codes = {};  ///< gcode::InterpretOptions::m_codes

  [[nodiscard]] double shortest_block(double feed) const {
    const double by_time = shortest_time > 0 ? feed * planner.feed_override * shortest_time
                                             : machining::shortest_block(feed * planner.feed_override, planner);
    return std::max(shortest_length, by_time);
  }
};

/// What a test cut told of this machine with this cutter (table [factors]): by how much the cutting forces of the
/// material and the compliances of the machine are multiplied.
struct Factors {
  double force = 1, compliance = 1;
  double force_uncertainty = 0;  ///< standard uncertainty of `force`; widens the spread of the cutting coefficients
};

/// What is known of the robot itself besides its compliance (table [robot_errors]); one number a joint that moves, or
/// none.
struct RobotErrors {
  std::vector<double> backlash;  ///< the whole play of each joint, rad or m
  std::vector<double> friction;  ///< Coulomb friction of each joint, Nm or N
  std::string signature_name;    ///< the machine as it was calibrated, its signature file; empty: none
  std::shared_ptr<const machine::AnyMachine> signature;

  [[nodiscard]] bool any() const { return !backlash.empty() || !friction.empty() || signature != nullptr; }
};

struct Job {
  std::string path;
  std::string machine_name;
  machine::AnyMachine machine;
  /// In the place of the joints' compliances, if it is there; reach and limits are the machine's all the same.
  std::shared_ptr<const MeasuredCompliance> measured;
  Pose X_MW;  ///< workpiece frame (that of G54) in the machine frame; turned about z_M only
  std::array<Vec3, 6> work_offsets{Vec3::Zero(), Vec3::Zero(), Vec3::Zero(),
                                   Vec3::Zero(), Vec3::Zero(), Vec3::Zero()};  ///< origins of G54..G59 in W, m
  /// Which of them the job says; the origin of G54 is that of W unless it says otherwise.
  std::array<bool, 6> offset_given{true, false, false, false, false, false};
  bool cuts = true;                        ///< tolerance, cutter, material and stock are given
  cutting::Cutter cutter;                  ///< for every tool number that has none of its own
  std::map<int, cutting::Cutter> cutters;  ///< by T number
  cutting::Material material;
  /// Masses of the machine, whose weight then counts in all deflections (WeightDeflection); null: it does not.
  std::shared_ptr<const motion::Dynamics> weights;
  Factors factors;       ///< `material` and `machine` are already multiplied by them
  cutting::Stock stock;  ///< in the frame S of `tool_frame`, which is W unless `set_up` tilted it
  ToolFrame tool_frame;
  double tolerance = 0;  ///< radius delta_t of the tube, m
  double step = 0;       ///< longest distance between evaluated points, m
  bool block_delete = false;
  Controller controller;
  std::vector<double> joint_speeds;         ///< largest of each joint, rad/s or m/s; empty: not said. Those of the
                                            ///< machine where the job gives none (infinite where it does not say)
  bool own_speeds = false;                  ///< the job gives them itself
  std::vector<double> joint_accelerations;  ///< the same, rad/s^2 or m/s^2
  std::vector<double> start_joints;         ///< where the joints stand before the program, rad or m; empty: not said
  /// The posture in which the program begins (kinematics::branch_name): `branch`, else that of `start_joints`; empty:
  /// the first within the limits.
  std::string posture;
  bool own_posture = false;  ///< the job says it itself
  RobotErrors robot_errors;
  double rapid_volume = 1e-9;  ///< m^3, of material; a rapid that goes through more is a collision

  [[nodiscard]] const cutting::Cutter& cutter_of(int tool) const {
    const auto it = cutters.find(tool);
    return it == cutters.end() ? cutter : it->second;
  }
  [[nodiscard]] gcode::InterpretOptions interpret_options() const {
    gcode::InterpretOptions options;
    options.work_offsets = work_offsets;
    options.block_delete = block_delete;
    options.m_codes = controller.m_codes;
    return options;
  }
};

/// One map from all the files (the columns of `polypod identify compliance`); no files make no map. `place` is where
/// they are asked for, if that is a file. `machine` is what the displacements are judged against (statics::judge);
/// without one they are not. Errors: ID1xx of the files, ID130 and ID131 of the map, ID140 to ID142 displacements that
/// cannot be, MC102 the tool axis of the measurements is more than 1 deg off z_M, the tool axis of every job.
Result<std::shared_ptr<const MeasuredCompliance>> read_measured(const std::vector<std::string>& files,
                                                                const Place& place = {},
                                                                const machine::AnyMachine* machine = nullptr);

/// By how much the workpiece is turned about z_M, rad, -pi .. pi.
double rotation_of(const Pose& X_MW);
/// Where the workpiece is, as headers of programs say it: "X-50 Y-1332.7679 Z0 mm", and ", turned by 30 deg about z"
/// where it is turned; to 0.1 um and 0.0001 deg.
std::string place_in_words(const Pose& X_MW);
/// "bull nose 8 mm, corner radius 1.5 mm, with 2 teeth", as headers of corrected programs have it.
std::string cutter_in_words(const cutting::Cutter& cutter);

/// "Ktc 1027.78 Krc 182.03 Kac 64.5 N/mm2, Kte 13.65 Kre 27.95 Kae 2.21 N/mm", and the exponent and the coefficients of
/// the end where there are some.
std::string material_in_words(const cutting::Material& material);
/// "X-5 Y-5 Z-20 to X105 Y65 Z0 mm, 154 cm3".
std::string stock_in_words(const cutting::Stock& stock);

/// Error: MC309 for a machine whose task does not hold x, y and z.
Status follows_programs(const machine::AnyMachine& machine);

/// The material with all forces multiplied.
cutting::Material scaled_forces(cutting::Material material, double factor);

/// What a job is read for: the cut, or the machine's motion alone.
enum class JobFor : std::uint8_t { cutting, motion };

/// Reads a job file (docs/job-files.md); paths in it are relative to it. A job that is read for motion needs no
/// tolerance, cutter, material and stock: it has all of them or none (Job::cuts). Errors: MC1xx and those of the parts.
Result<Job> read_job(const std::string& path, JobFor purpose = JobFor::cutting);

}  // namespace polypod::machining
