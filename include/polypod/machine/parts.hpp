// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a machine is made of, apart from its kinematics: what deflects, what a picture shows, how far it reaches.
#pragma once

#include <string>
#include <vector>

#include "polypod/machine/common.hpp"

namespace polypod::machine {

/// Something that deflects under load.
struct Element {
  std::string name;       ///< "joint 1", "leg 1", "rod 1", ...
  double compliance = 0;  ///< rad/Nm where it turns, m/N where it slides or stretches
  bool turns = false;
};

/// What the tool does, [m; rad] in M, for a unit by which each element deflects; in the order of `elements`.
struct ElementColumns {
  Pose X_MT;
  JacobianMatrix J;
};

/// A part as lines in M.
struct OutlinePart {
  /// How it is drawn: what stands still, what moves, the platform, the tool, and joints as dots.
  enum class Role { fixed, moving, platform, tool, joints } role = Role::moving;
  std::string name;          ///< "base", "legs at home", ...; empty where it needs none
  std::vector<Vec3> points;  ///< m, one after the other
  bool thick = true;
  bool plate = false;  ///< the points go round a plate (the base of a delta); else they are lines (rails, links)
};
using Outline = std::vector<OutlinePart>;
/// What moves, and the platform, called so: "legs" becomes "legs at home".
inline Outline called(Outline outline, const std::string& where) {
  for (OutlinePart& part : outline) {
    const bool moves = part.role == OutlinePart::Role::moving || part.role == OutlinePart::Role::platform;
    if (moves && !part.name.empty()) part.name += where;
  }
  return outline;
}

/// A box in M, m.
struct Reach {
  Vec3 low = Vec3::Zero(), high = Vec3::Zero();
};

}  // namespace polypod::machine
