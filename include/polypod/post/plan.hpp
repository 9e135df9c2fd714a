// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How a machine carries out a part program: its rotary axes, its joints, the points that must be inserted.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/machine/any_machine.hpp"
#include "polypod/post/path.hpp"

namespace polypod::post {

/// Which rotary words turn the tool. R = R_z(C) R_y(B) R_x(A), the tool axis is its third column.
enum class Rotary : std::uint8_t {
  none,  ///< X Y Z: the tool stays along z
  ab,    ///< C = 0; SLAV 2.2.1, vertical and horizontal machines (X, Y, Z, A, B)
  ac,    ///< B = 0; SLAV 2.2.1, vertical machines (X, Y, Z, A, C)
  abc    ///< A and B at a C that is given
};

/// A machine as it is programmed: SLAV 2.2.1 makes five-axis machine tools of one arm with six joints.
struct Configuration {
  std::string name;              ///< "vertical-ab", "horizontal-ab", "vertical-ac", "six", "ab", "abc", "xyz"
  machine::AnyMachine machine;   ///< with the joint locked
  machine::AnyMachine unlocked;  ///< as given
  Rotary rotary = Rotary::ab;
};

/// `auto` takes what the machine's task is; `vertical-ab` locks joint 6 at 0 and `horizontal-ab` joint 4, unless the
/// machine file has locked it; `vertical-ac` and `six` move all six joints.
/// Errors: PO120 a configuration that the machine does not have, PO121 a machine without x, y and z or with a task that
/// no program prescribes.
Result<Configuration> configure(const machine::AnyMachine& machine, const std::string& name);

/// What the controller does between two points; the tip goes straight in both.
enum class Between : std::uint8_t {
  angles,  ///< A, B, C turn linearly with the way (LinuxCNC)
  turn     ///< the tool turns about one axis from the first orientation to the second (LIN, MoveL, movel)
};

/// What an external axis does that carries the arm, a rail or a turntable (machine::CarriedArm::on_external_axis); on
/// other machines nothing.
enum class External : std::uint8_t {
  follows,  ///< as the inverse moves it from pose to pose
  linear,   ///< at the end of each step as `follows`, and linearly between, as robots' controllers do
  chosen,   ///< chosen along the program, as C is; linearly between its steps
  stands    ///< at external_at
};

struct PlanOptions {
  Vec3 origin = Vec3::Zero();  ///< p_MW, m
  double rotation = 0;         ///< rad, of W about z_M
  /// Whether the tool may tilt or turn where W is turned: in languages that say orientations in the frame of the work,
  /// and of machines with A, B and C. Elsewhere it stays along z there.
  bool tilts_with_work = false;
  double tolerance = 1e-5;                 ///< m, of the chords of arcs that are not written as arcs
  double axis_tolerance = 1.745329252e-3;  ///< rad, of the tool axis between two points (0.1 deg)
  double turn_speed = 0.5235987756;        ///< rad/s of a turn without a way (1800 deg/min)
  double rapid_speed = 0.1;                ///< m/s that rapids are counted with
  double step = 1e-3;                      ///< m, between judged poses
  double turn_step = 0.0175;               ///< rad, the same for turns
  Between between = Between::angles;
  bool length_offsets = true;      ///< whether G43 moves the tip; not where the language has one TCP for all
  bool arcs_in_any_plane = false;  ///< circles of robots; LinuxCNC's lie along two of x, y, z
  double largest_sweep = 0;        ///< rad, arcs are split into pieces of at most this; 0: one piece
  /// Rotary::abc: C, rad; empty: chosen along the program. A G-code program that commands C keeps its own; of one that
  /// commands A or B alone the tool axes count, where this is not 0.
  std::optional<double> c = 0.0;
  External external = External::follows;
  double external_at = 0;    ///< rad or m
  std::string branch;        ///< the posture to begin with; empty: the first in which all is well
  bool keep_branch = false;  ///< a cut in another posture than `branch` is a problem of kind "branch"
  /// Largest speed of each joint, rad/s or m/s, one a joint of the configuration; empty: not judged. Cuts are judged at
  /// their feed; rapids go as fast as the joints let them.
  std::vector<double> joint_speeds;
  /// Where the joints are before the program: its posture is the one that the program begins in, and `c`, where it is
  /// chosen, begins near to it.
  std::optional<machine::JointVector> start_joints;
  std::function<bool(double)> progress = [](double) { return true; };
};

/// A point of the written program.
struct PlannedMove {
  StepKind kind = StepKind::rapid;  ///< rapid, line, arc
  int step = 0;                     ///< index into Path::steps
  bool inserted = false;            ///< not an end of a step
  Vec3 tip = Vec3::Zero();          ///< p_W, m
  Vec3 angles = Vec3::Zero();       ///< A, B, C, rad, as they turn on and on
  Mat3 R = Mat3::Identity();        ///< R_WT that the machine then has
  machine::JointVector joints;      ///< empty where the pose is out of reach
  double external = 0;              ///< rad or m, where the external axis stands
  Vec3 via = Vec3::Zero();          ///< arcs: the tip half way
  Mat3 R_via = Mat3::Identity();
  Vec3 centre = Vec3::Zero(), normal = Vec3::UnitZ();
  double sweep = 0;    ///< arcs: rad; 0: none
  double length = 0;   ///< m, of the tip's way
  double turn = 0;     ///< rad, by which the tool's axis turns
  double seconds = 0;  ///< without accelerations
};

struct PlanProblem {
  int line = 0;
  /// "reach", "limit", "singular", "branch" (as of `check`), "rewind" (a joint at the end of its range that would go on
  /// a whole turn back), "axis" (an axis that the configuration cannot take), "speed" (a joint is faster than it may
  /// be)
  std::string kind;
  std::string detail;
};

struct Plan {
  std::vector<PlannedMove> moves;
  std::vector<PlanProblem> problems;  ///< the first of each kind of each line
  std::vector<std::string> notes;
  std::string branch;                                ///< the posture of the first point
  bool sets_c = false;                               ///< C is not that of the source, a program without C
  int inserted = 0;                                  ///< points between the ends of steps, chords of arcs among them
  double chord_error = 0;                            ///< m, the largest of arcs that are written as chords
  int chorded = 0;                                   ///< arcs that are written as chords
  double axis_error = 0;                             ///< rad, the largest between two points
  double time = 0;                                   ///< s
  double length = 0;                                 ///< m
  std::array<double, 3> turned_min{}, turned_max{};  ///< rad, of A, B, C
  std::vector<machine::JointRange> joints;
  double speed_share = 0;  ///< the largest share of its speed limit that a joint takes in a cut ...
  int speed_joint = 0;     ///< ... which joint, from 1; 0: none was judged
  int speed_line = 0;      ///< ... and in which line

  [[nodiscard]] bool ok() const { return problems.empty(); }
};

/// The path as the machine takes it. Of all pairs of rotary angles that point the tool the same way, the one nearest to
/// the last is taken, in whatever turn; at a pole (A = 0 of A C, A = 90 deg of A B) the free angle stays. The joints
/// follow the posture with which the program begins, the first in which nothing is wrong if there is one. Between two
/// CL points the axis is meant to turn along the shortest way: points are inserted where it would leave that by more
/// than the tolerance. Judged are poses `step` and `turn_step` apart. Rapids to places that are not known whole have no
/// PlannedMove, and of the move behind them the end alone is judged; a note names them.
/// Joint speeds are judged between judged poses, ten times closer where one comes to a fifth of its limit.
/// Errors: PO127 as many speeds or start joints as the configuration has joints are needed; PO124 a turned workpiece
/// and a tool that tilts or turns about its axis; PO122 a branch that the first point does not have, PO123 C cannot be
/// chosen along this program or on this machine, PO199 cancelled. Cost: one inverse a judged pose.
Result<Plan> plan(const Configuration& configuration, const Path& path, const PlanOptions& options = {});

/// The first cut that is planned with the tool turned about its axis against what its program says, by more than 1e-6
/// rad; nullptr where there is none, or where the plan sets C for a program without it.
const Step* turned_cut(const Path& path, const Plan& plan);

}  // namespace polypod::post
