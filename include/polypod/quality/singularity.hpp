// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Singular poses: which kind, how far, and which motion is lost or cannot be held (JEL 6.3).
#pragma once

#include <algorithm>
#include <optional>
#include <string>

#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/hold.hpp"

namespace polypod::quality {

using kinematics::JointVector;
using machine::AnyMachine;

/// How near a pose is to singular. From A dX + B dq = 0 with A = F_X, B = F_q of the closure, angles as lengths on L,
/// each equation divided by the length of its translational part (by that of its rotational part if it has no other):
/// the smallest singular values of both sides, without unit, 0 singular and of the order of 1 far from it.
/// Serial arms have A = 1; their B is what the task sees of the Jacobian.
struct Singularity {
  int kind = 0;         ///< 0 regular; 1 B, 2 A, 3 both below the threshold
  double mobility = 0;  ///< of B: near 0 the drives move though the tool stands; the tool loses a motion
  double control = 0;   ///< of A: near 0 the tool moves though the drives stand; it cannot hold a load
  Vec6 lost_motion =
      Vec6::Zero();  ///< the twist of the tip that is hardest for the drives; in M, [v; w] with |[v; L w]| = 1
  Vec6 free_motion = Vec6::Zero();  ///< the twist of the tip that they hold least
  JointVector idle_joints;          ///< the joint motion that moves the tool least, scaled to a largest part of 1
  double length = 0;                ///< L, m
  /// Of machines whose constraints hold coordinates that no pose prescribes: the smallest singular value of these
  /// equations alone, scaled like A. Near 0 the constraints let the platform go, whatever the drives do.
  std::optional<double> constraints;
};

inline constexpr double kSingularThreshold = kinematics::kLittleHold;

/// L as in kinematics::dexterity unless `length` is above 0. Cost: 10 us.
Singularity singularity(const AnyMachine& machine, const Pose& X_MT, const JointVector& q, double length = 0,
                        double threshold = kSingularThreshold);

/// Whether what the task prescribes of the pose fixes the joints: false where the machine is regular and a motion of
/// its drives moves the tool without changing a coordinate of the task (the condition number exceeds 1e12). `s` is the
/// singularity() there.
bool task_prescribes(const AnyMachine& machine, const Pose& X_MT, const JointVector& q, const Singularity& s);
/// Where it does not.
inline constexpr const char* kNotPrescribed =
    "its task does not prescribe a pose here: drives move the tool, and no coordinate of the task changes; joints of "
    "this "
    "pose are one choice of many";

/// A twist of the tool's tip as a person says it: "turns about its own axis", "moves along z", "turns about the axis
/// through 10.0, 0.0, 5.0 mm along 0.00, 1.00, 0.00", "... and moves along it by 3.0 mm per rad". What is below 3 % of
/// the rest is left out.
std::string motion_in_words(const Pose& X_MT, const Vec6& twist, double length);

/// "loses a motion (type 1, serial singularity): the tool cannot do this: ..." or "cannot be constrained (type 2: ...";
/// of a regular pose, how far it is.
std::string in_words(const Pose& X_MT, const Singularity& s);

/// The least regular pose of a straight path.
struct PathSingularity {
  double share = 0;  ///< 0 at the start, 1 at the end
  Pose X_MT;
  Singularity at;
  bool crossed = false;    ///< the determinant changes its sign on the way: a singular pose lies on the path
  double reached = 1;      ///< the share up to which the joints follow within their limits
  std::string stopped_by;  ///< why not further
};
/// From X to Y the tip moves straight and the orientation turns at a constant rate about one axis; `samples` steps,
/// then the least of the smaller of the singular values of B (mobility) and A (control) is refined to 1e-6 of the path.
/// Joints follow by continuity.
PathSingularity along_path(const AnyMachine& machine, const Pose& from_MT, const Pose& to_MT, int samples = 200);

/// Below this a smallest singular value is 0 but for rounding: the side has lost rank.
inline constexpr double kRankLost = kinematics::kNoHold;

/// Whether a machine is singular wherever it stands: architecturally singular, as hexapods with congruent or similar
/// regular hexagons for base and platform are.
struct PoseIndependentSingularity {
  int poses = 0;                ///< at which it was judged: home (not of serial arms) and pseudo-random ones
  int within_limits = 0;        ///< of these, poses that keep every limit
  int type1 = 0, type2 = 0;     ///< of these, poses where B, A has lost rank (kRankLost)
  double largest_mobility = 0;  ///< of the smallest singular values of B that were seen
  double largest_control = 0;   ///< of those of A

  /// No pose was found where the drives hold the platform (type 2).
  [[nodiscard]] bool never_held() const { return poses > 0 && type2 == poses; }
  /// No pose was found where the tool has all its motions (type 1).
  [[nodiscard]] bool never_moves_freely() const { return poses > 0 && type1 == poses; }
  [[nodiscard]] bool everywhere() const { return never_held() || never_moves_freely(); }
  /// Not quite singular, but below `threshold` at every pose.
  [[nodiscard]] bool nearly(double threshold = kSingularThreshold) const {
    return poses > 0 && !everywhere() && std::min(largest_control, largest_mobility) < threshold;
  }
};

/// Judges the rank of both sides of A dX + B dq = 0, scaled as `singularity` does, at home and at 32 pseudo-random
/// poses round it, the same at every call, that keep all limits (where fewer are found in 800 trials: any that the
/// joints can take). det A is an analytic function of the pose, so one that vanishes at random poses vanishes at all
/// but for a chance of nil; that it was judged at N poses is said all the same. Arms: at joints over their ranges; one
/// with fewer joints than its task has coordinates lacks motions by design, which is not judged.
/// Cost: 2 ms.
PoseIndependentSingularity pose_independent_singularity(const AnyMachine& machine);

/// "singular at every pose (judged at 33 of 33 poses ...): ...", or that it is nearly so; empty where it is neither.
std::string in_words(const PoseIndependentSingularity& s);

/// A singular pose near X and its distance: Newton's steps of least length on the determinant of the side that can be
/// singular, in the space of [p; L rotation]. Local: a nearer one may exist. Empty where 50 steps do not find it, or
/// where the machine's Jacobian is not square.
struct NearSingularity {
  Pose X_MT;
  double translation = 0;  ///< m
  double rotation = 0;     ///< rad
};
std::optional<NearSingularity> nearest(const AnyMachine& machine, const Pose& X_MT, const JointVector& q,
                                       double length = 0);

}  // namespace polypod::quality
