// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Machines in series: closure and limits on any number type by those of the stages, inverse by a search that keeps
// every stage on what it can do, forward, Jacobian.
#pragma once

#include <cmath>
#include <optional>
#include <type_traits>

#include "polypod/core/series.hpp"
#include "polypod/families/hexapod/kinematics.hpp"
#include "polypod/families/serial/kinematics.hpp"
#include "polypod/families/stages/machine.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/closure.hpp"

namespace polypod::machine {

inline int joint_count(const Stages& m) {
  int n = 0;
  for (const StageData& stage : m.data) n += stage.joints;
  return n;
}
JointKind joint_kind(const Stages& m, int joint);
JointRange joint_range(const Stages& m, int joint);
double joint_speed_limit(const Stages& m, int joint);
inline Task task(const Stages& m) {
  return m.task;
}

/// The values of parameters(m), without their names.
std::vector<double> parameter_values(const Stages& m);

namespace stages_detail {

/// Joints, parameters and mount of each stage, one after the other.
template <class T, class Take>
void each_stage(const Stages& m, std::span<const T> q, std::span<const T> p, Take&& take) {
  std::size_t joint = 0, parameter = 0;
  for (std::size_t k = 0; k < m.machines.size(); ++k) {
    const auto joints = static_cast<std::size_t>(m.data[k].joints);
    const auto parameters = static_cast<std::size_t>(m.data[k].parameters);
    PoseT<T> mount = m.data[k].mount.cast<T>();
    if (k > 0) {
      const std::span<const T> figures = p.subspan(parameter, 6);  // x, y, z, A, B, C
      mount = {rotation_by_angles(figures[3], figures[4], figures[5]), {figures[0], figures[1], figures[2]}};
      parameter += 6;
    }
    take(k, mount, q.subspan(joint, joints), p.subspan(parameter, parameters));
    joint += joints;
    parameter += parameters;
  }
}

/// The pose of the tool of the closed stage in its own M, with what stands before and behind it taken away.
template <class T>
PoseT<T> pose_of_closed(const Stages& m, const PoseT<T>& X_MT, std::span<const T> q, std::span<const T> p) {
  PoseT<T> before = Pose{}.cast<T>(), behind = before;
  each_stage<T>(m, q, p, [&](std::size_t k, const PoseT<T>& mount, std::span<const T> joints, std::span<const T> own) {
    if (k == m.closed) {
      before = before * mount;
      return;
    }
    const PoseT<T> tool = mount * chain<T>(std::get<SerialArm>(m.machines[k]), joints, own);
    (k < m.closed ? before : behind) = (k < m.closed ? before : behind) * tool;
  });
  return before.inverse() * X_MT * behind.inverse();
}

}  // namespace stages_detail

/// The closure of the stage with closed loops at X_c = (X_1 Y_1 ... X_c)^-1 X_MT (X_c+1 Y_c+1 ...)^-1; of serial chains
/// alone that of the last one.
template <class T>
ClosureVectorT<T> closure(const Stages& m, const PoseT<T>& X_MT, std::span<const T> q, std::span<const T> p) {
  const PoseT<T> X = stages_detail::pose_of_closed<T>(m, X_MT, q, p);
  ClosureVectorT<T> F;
  stages_detail::each_stage<T>(
      m, q, p, [&](std::size_t k, const PoseT<T>&, std::span<const T> joints, std::span<const T> own) {
        if (k != m.closed) return;
        F = std::visit(
            [&]<class M>(const M& stage) -> ClosureVectorT<T> {
              if constexpr (std::is_same_v<T, Series> &&
                            requires { requires decltype(closure_takes_no_series(stage))::value; }) {
                return {};  // closure_takes_no_series(m) says so
              } else {
                return closure(stage, X, joints, own);
              }
            },
            m.machines[k]);
      });
  return F;
}

/// Whether its stage with closed loops is of a family of one's own.
inline bool closure_takes_no_series(const Stages& m) {
  return std::holds_alternative<Own>(m.machines[m.closed]);
}

/// Those of each stage, then how far the tool tip is above the least x, y, z, m, and below the largest; 1 where no
/// limit is given.
template <class T>
std::vector<T> limits(const Stages& m, const PoseT<T>& X_MT, std::span<const T> q, std::span<const T> p) {
  const PoseT<T> X = stages_detail::pose_of_closed<T>(m, X_MT, q, p);
  std::vector<T> g;
  stages_detail::each_stage<T>(
      m, q, p, [&](std::size_t k, const PoseT<T>&, std::span<const T> joints, std::span<const T> own) {
        const PoseT<T> at = k == m.closed ? X : Pose{}.cast<T>();  // the limits of chains are those of their joints
        const std::vector<T> of_stage = std::visit(
            [&](const auto& stage) -> std::vector<T> { return limits(stage, at, joints, own); }, m.machines[k]);
        g.insert(g.end(), of_stage.begin(), of_stage.end());
      });
  hexapod_detail::push_tip_limits(g, m, X_MT.p);
  return g;
}

/// Those of the stages, one after the other.
template <class T>
std::vector<T> parameter_rules(const Stages& m, std::span<const T> p) {
  const std::vector<T> q(static_cast<std::size_t>(joint_count(m)), T(0.0));
  std::vector<T> out;
  stages_detail::each_stage<T>(
      m, q, p, [&](std::size_t k, const PoseT<T>&, std::span<const T>, std::span<const T> own) {
        const std::vector<T> of_stage =
            std::visit([&](const auto& stage) { return kinematics::rules_of(stage, own); }, m.machines[k]);
        out.insert(out.end(), of_stage.begin(), of_stage.end());
      });
  return out;
}

/// "stage 1: leg 2 below its minimum", ...
std::string limit_name(const Stages& m, int limit);
/// Groups 1, 2, ... of the stages, and coordinates.
LimitTable limit_table(const Stages& m);

/// Every stage at home.
Pose home_pose(const Stages& m);

/// The chains at their joints, the closed stage where Newton's method comes from its own home.
kinematics::NewtonResult forward_from_home(const Stages& m, const JointVector& q);
Pose forward(const Stages& m, const JointVector& q);

/// The whole pose that the machine has at the joints q: that of X_MT where it closes there, else the closed stage is
/// settled first, else it comes from its home.
Pose settled(const Stages& m, const Pose& X_MT, const JointVector& q);

/// Of a wrist on a module that places it (two joints that meet the tool axis, or three that meet) in closed form for
/// the module's own pose: WristOnModule. Of all others the poses that up to 24 searches find (until eight find nothing
/// new), by distance from home: Levenberg and Marquardt's method on the joints of all stages, where the closed stage is
/// settled again after each step, so that it never leaves what its constraints allow. Starts: home, then chains at
/// points of a Halton sequence in their ranges. Not proven to be all. For each the solutions of the closed stage's own
/// inverse.
kinematics::InverseResult inverse(const Stages& m, const Pose& X_MT);
/// Whether one of them keeps the limits `heeded`. The searches end with the first that does, or where four find nothing
/// new.
bool reaches(const Stages& m, const Pose& X_MT, LimitBits heeded);
/// "posture 1", ..., with the branch of the closed stage behind it where that has several.
std::string branch_name(const Stages& m, unsigned branch);
/// The one that a search from the joints `start` finds; none where it does not converge.
inline bool has_closed_inverse(const Stages&) {
  return false;
}
kinematics::InverseResult inverse_from(const Stages& m, const Pose& X_MT, const JointVector& start);

/// The columns of each stage, carried to the tool tip.
JacobianMatrix jacobian(const Stages& m, const Pose& X_MT, const JointVector& q);

/// Where each stage stands at the joints q: X_MB, its own M in that of the machine, and its tool's pose in its own M.
struct StagePose {
  Pose X_MB, X;
  JointVector q;
};
std::vector<StagePose> stage_poses(const Stages& m, const Pose& X_MT, const JointVector& q);
/// A twist of a stage's tool, in its own M, as the twist of the tool tip at p_M that it causes.
Vec6 carried(const StagePose& stage, const Vec6& twist, const Vec3& p_M);

static_assert(kinematics::Machine<Stages>);

}  // namespace polypod::machine
