// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Machines whose module places a wrist: the centre of the wrist first, then its joints in closed form.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "polypod/families/parallel/machine.hpp"
#include "polypod/families/stages/kinematics.hpp"

namespace polypod::machine {

/// A module with closed loops that prescribes x, y and z (a delta, or a machine of legs), and a wrist behind it: two
/// turning joints whose axes meet each other and the tool axis (the task is tip and tool axis), or three whose axes
/// meet (the task is a pose), as of a Tricept with its wrist. The target says where the centre W of the wrist is, W = p
/// + w k or X_MT W_T, and W is a point of the module's tool frame: the module with its tool tip there is settled at W,
/// which gives its orientation R. Then u1, u2 and u3 turn the tool as Paden and Kahan's second and first subproblems
/// say (Murray, Li and Sastry, A Mathematical Introduction to Robotic Manipulation, 3.3).
///
/// Solutions: two of the wrist, for the module in the assembly mode that it comes to from home, times the module's own.
/// Singular: the tool axis (of three joints: axis 3) along axis 1, where joint 1 is free.
/// Cost: of a Tricept some 25 us.
class WristOnModule {
 public:
  /// Nothing where the machine is none.
  static std::optional<WristOnModule> of(const Stages& m);

  struct Posture {
    std::vector<StagePose> stages;  ///< without the joints of the module
    bool singular = false;
  };
  struct Found {
    std::vector<Posture> postures;
    std::string reason;  ///< why there is none
  };
  /// A free joint 1 takes the value `first`, rad.
  [[nodiscard]] Found solve(const Stages& m, const Pose& X_MT, double first) const;

  /// A module of legs with its tool tip at W; none of another kind.
  [[nodiscard]] const std::optional<Parallel>& placing() const { return placing_; }
  [[nodiscard]] const Vec3& centre_in_module() const { return v_; }
  [[nodiscard]] const Vec3& centre_in_tool() const { return W_T_; }
  /// The axes of the wrist at joints 0, in its {M}; R_0 is the tool's orientation there.
  [[nodiscard]] const std::vector<Vec3>& axes() const { return u_; }
  [[nodiscard]] const Mat3& tool_at_zero() const { return R_0_; }

 private:
  [[nodiscard]] std::optional<Pose> module_at(const Stages& m, const Vec3& c) const;

  Vec3 W_ = Vec3::Zero(), v_ = Vec3::Zero();  ///< the centre in {M} of the wrist, in the module's tool frame
  Vec3 W_T_ = Vec3::Zero();                   ///< and in that of the tool
  std::optional<Parallel> placing_;           ///< a module of legs with its tool tip at W
  std::vector<Vec3> u_;                       ///< axes at joints 0, in {M} of the wrist
  Mat3 R_0_ = Mat3::Identity();               ///< the tool's orientation there
};

}  // namespace polypod::machine
