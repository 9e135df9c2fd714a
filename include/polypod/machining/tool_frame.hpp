// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How the tool stands in the cuts of a program, and the frame of the stock that goes with it.
#pragma once

#include <Eigen/Geometry>

#include "polypod/geometry/pose.hpp"

namespace polypod::machining {

/// How the tool stands in cuts: in one orientation in all of them (3 + 2 axes) or in that of each move, and the frame S
/// in which the stock is a height map: its origin is that of W, its z axis the tool axis, its x and y axes those of T
/// for a workpiece that is not turned. By default the tool stands along z of M (cutting_orientation says how it is
/// turned about it) and S is W.
struct ToolFrame {
  /// Whether the tool turns in cuts, or cuts in several orientations: a ball, whose way is that of its middle. S is W
  /// then, and the orientation that of the move (cutting_orientation).
  bool turns = false;
  bool tilted = false;               ///< whether S is another frame than W
  Vec3 axes = Vec3::Zero();          ///< A, B, C in every cut, rad
  Mat3 R_MT = Mat3::Identity();      ///< the orientation of the tool in M; only where the tool is tilted
  Mat3 R_WS = Mat3::Identity();      ///< S in W
  Eigen::AlignedBox3d stock_in_W{};  ///< the box of the stock as the job gives it, m; only where the tool is tilted

  [[nodiscard]] Vec3 to_S(const Vec3& v_W) const { return tilted ? Vec3(R_WS.transpose() * v_W) : v_W; }
  [[nodiscard]] Vec3 to_W(const Vec3& v_S) const { return tilted ? Vec3(R_WS * v_S) : v_S; }
  /// The tool axis in W, from the tip to the spindle.
  [[nodiscard]] Vec3 axis() const { return R_WS.col(2); }
  /// W's frame in M becomes that of S.
  [[nodiscard]] Pose to_S(const Pose& X_MW) const { return tilted ? Pose{X_MW.R * R_WS, X_MW.p} : X_MW; }
};

}  // namespace polypod::machining
