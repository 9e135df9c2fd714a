// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What every family of machines is described with.
#pragma once

#include <cmath>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "polypod/geometry/pose.hpp"
#include "polypod/machine/task.hpp"

namespace polypod::machine {

/// Joints, closure equations and limits live on the stack: no machine has more than this many of each.
inline constexpr int kMaxJoints = 12;
inline constexpr int kMaxEquations = 12;

template <class T>
using JointVectorT = Eigen::Matrix<T, Eigen::Dynamic, 1, 0, kMaxJoints, 1>;
/// Joint coordinates: rad for revolute joints, m for prismatic ones.
using JointVector = JointVectorT<double>;
template <class T>
using ClosureVectorT = Eigen::Matrix<T, Eigen::Dynamic, 1, 0, kMaxEquations, 1>;
using ClosureVector = ClosureVectorT<double>;
/// 6 x joints: twist [linear; angular] in M per joint speed.
using JacobianMatrix = Eigen::Matrix<double, 6, Eigen::Dynamic, 0, 6, kMaxJoints>;

enum class JointKind { revolute, prismatic };

/// A named number of a machine, in SI; `unit` says what a person sees ("mm", "deg", "rad/Nm", "").
struct Parameter {
  std::string key;
  double value = 0;
  std::string unit;
};

/// What a limit of a machine is, in the order of `limits(m, ...)`.
struct LimitInfo {
  std::string group;            ///< what `--without` calls it: "length", "base-joint", "coordinates", ...
  double scale = 1;             ///< its value times this is in m: 1 for lengths, a lever for angles and cosines
  bool given = true;            ///< the machine has it at all; else its value is constant and above 0
  bool between_bodies = false;  ///< whether bodies touch: checked only where interference is asked for
  bool holds_reach = false;     ///< the range of a drive without which the machine would have no end
};
using LimitTable = std::vector<LimitInfo>;

/// Where the numbers of a machine come from: key of the file -> source.
using Provenance = std::map<std::string, std::string>;

/// The box of M in which the tool tip must stay, m; infinite where no limit is given.
struct TipLimits {
  Vec3 low = Vec3::Constant(-std::numeric_limits<double>::infinity());
  Vec3 high = Vec3::Constant(std::numeric_limits<double>::infinity());
};

/// Adds the six limits of the tool tip to a table, those below the least values first.
inline void push_tip_limits(LimitTable& out, const TipLimits& tip) {
  for (int k = 0; k < 3; ++k) out.push_back({"coordinates", 1, std::isfinite(tip.low[k])});
  for (int k = 0; k < 3; ++k) out.push_back({"coordinates", 1, std::isfinite(tip.high[k])});
}

/// The range of a joint, rad or m.
struct JointRange {
  double min = 0;
  double max = 0;
};

}  // namespace polypod::machine
