// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Static compliance of the tool tip from the compliance of the joints (SLAV chapter 4).
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod::statics {

using machine::AnyMachine;

/// The tool tip's compliance at one pose.
struct Compliance {
  bool reachable =
      false;           ///< a solution of the inverse kinematics keeps all limits, and the drives hold the tool there
  std::string reason;  ///< why not; or that C is 0 since the machine has no compliances
  Pose X_MT;
  machine::JointVector joints;     ///< the solution that was used, rad or m
  Mat6 C = Mat6::Zero();           ///< displacement and turn [m; rad] per force and moment [N; Nm], in M
  std::vector<Mat6> by_joint;      ///< each joint's share; their sum is C (SLAV (4.23), (4.27))
  std::vector<std::string> joint;  ///< names of the shares, "joint 1", ...

  /// The 3 x 3 part that SLAV uses: displacement of the tip per force, m/N (SLAV (4.26)).
  [[nodiscard]] Mat3 linear() const { return C.topLeftCorner<3, 3>(); }
  /// Displacement of the tip under a force in M, m (SLAV (4.25)).
  [[nodiscard]] Vec3 displacement(const Vec3& force) const { return linear() * force; }
};

/// C_X = J C_q J^T (SLAV (4.20)) = sum over joints of c_i J_i J_i^T, symmetric and positive semidefinite; no inverse of
/// J is needed, so it also holds at singular poses. Parallel machines with more chains than freedoms (deltas of four
/// arms) share their load as the stiffnesses are; their J is weighted with them. Joints: the first inverse solution
/// within all limits; where none reach the pose, not `reachable`, with the reason. Of a machine without compliances C
/// is 0 and `reason` says so (needs_compliance asks before). Cost: about 2 us for a serial arm with a closed inverse.
Compliance compliance_at(const AnyMachine& machine, const Pose& X_MT);
/// The same at given joints.
Compliance compliance_at_joints(const AnyMachine& machine, const machine::JointVector& q);

/// J_k J_k^T of every joint (and of every locked one) at the pose X_MT with the joints q: the 3 x 3 compliance of the
/// tip per unit compliance of that joint, in the order of Compliance::by_joint.
std::vector<Mat3> unit_compliances(const AnyMachine& machine, const Pose& X_MT, const machine::JointVector& q);
/// "joint 1", ..., "leg 1", ... or "drive 1", ..., "rod 1", ..., in the same order.
std::vector<std::string> column_names(const AnyMachine& machine);
/// Whether each of them turns (rad/Nm) or slides or stretches (m/N).
std::vector<bool> column_turns(const AnyMachine& machine);
/// The compliance of each of them, rad/Nm (m/N where the joint slides, a strut or rod deflects), and the machine with
/// others. Errors: MA105 for another count.
std::vector<double> column_compliances(const AnyMachine& machine);
Result<AnyMachine> with_compliances(const AnyMachine& machine, const std::vector<double>& compliances);

/// Whether any joint has a compliance.
bool has_compliance(const AnyMachine& machine);
/// Errors: AP105 where the machine has none; says which keys give them.
Status needs_compliance(const AnyMachine& machine);

/// The compliance of the tip for inner loops: only the 3 x 3 part, no allocation, warm start for numeric inverses.
/// Keeps the last joints, so one object belongs to one thread.
class Probe {
 public:
  /// `R_MT`: the orientation of the tool in M; its turn about the tool axis counts only where the task has it.
  /// `posture`: that of the first pose (kinematics::branch_name), which an arm with a closed inverse of point and axis
  /// keeps; empty: the first within the limits. `start`: the joints before the first pose, rad or m; of what that
  /// leaves open, such as a free joint, the nearest to these. Empty: not said.
  Probe(const AnyMachine& machine, const Mat3& R_MT, std::string posture = {}, const std::vector<double>& start = {});
  ~Probe();
  Probe(Probe&&) noexcept;
  Probe& operator=(Probe&&) noexcept;

  /// Compliance at the tip position p_M, m/N. False where the pose is out of reach or breaks a limit; then `why()` says
  /// which. Cost: below 1 us for an arm with a closed inverse.
  bool at(const Vec3& p_M, Mat3& C);
  /// From here on with the tool in another orientation in M.
  void turn_to(const Mat3& R_MT);
  /// Whether the joints follow those of the pose before: not where each pose has its own in the posture (a closed
  /// inverse of point and axis).
  [[nodiscard]] bool follows() const;
  /// The tool goes to a pose without a question for its compliance: the joints follow. What is out of reach is passed.
  void follow(const Pose& X_MT);
  /// The joints stand at q.
  void stand_at(const machine::JointVector& q);
  [[nodiscard]] std::string why() const;
  /// Joints of the last pose that `at` reached.
  [[nodiscard]] const machine::JointVector& joints() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// A rectangle in M with a grid on it: p = origin + u i/(columns-1) + v j/(rows-1).
struct PlaneGrid {
  Vec3 origin = Vec3::Zero();
  Vec3 u = Vec3::UnitX();  ///< m
  Vec3 v = Vec3::UnitY();  ///< m
  int columns = 2;
  int rows = 2;
  [[nodiscard]] Vec3 point(int column, int row) const {
    return origin + u * (columns > 1 ? double(column) / (columns - 1) : 0.0) +
           v * (rows > 1 ? double(row) / (rows - 1) : 0.0);
  }
};

/// One map point: compliance and determinant of the task Jacobian (SLAV 2.4.3, 4.5).
struct MapPoint {
  Vec3 p_M = Vec3::Zero();
  Compliance compliance;
  double determinant = 0;  ///< SI; 0 where the pose is out of reach
};
struct Map {
  PlaneGrid grid;
  std::vector<MapPoint> points;  ///< row by row, columns fastest
};
/// That at one pose (what the task prescribes of it); p_M is the tool tip as the machine settles there, that of X_MT
/// where it is out of reach.
MapPoint map_point(const AnyMachine& machine, const Pose& X_MT);
/// Compliances, shares and det J over a plane at a fixed orientation (SLAV Figures 2.18, 4.12 to 4.14).
Map compliance_map(const AnyMachine& machine, const PlaneGrid& grid, const Mat3& R_MT);

/// Displacement along a straight way under a constant force (SLAV 4.6, Figures 4.15, 4.16): at each point the total and
/// each joint's share, m, in M.
struct PathError {
  Vec3 p_M = Vec3::Zero();
  bool reachable = false;
  Vec3 total = Vec3::Zero();
  std::vector<Vec3> by_joint;
};
std::vector<PathError> path_error(const AnyMachine& machine, const Vec3& from_M, const Vec3& to_M, int points,
                                  const Mat3& R_MT, const Vec3& force_M);

}  // namespace polypod::statics
