// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// One joint of a URDF file by urdfdom.
#pragma once

#include <string>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/geometry/pose.hpp"

namespace polypod::machine {

/// A joint as urdfdom reads it; SI.
struct UrdfJoint {
  Vec3 origin = Vec3::Zero();
  Vec3 axis = Vec3::UnitX();                  ///< as the file has it, of any length
  double lower = 0, upper = 0, velocity = 0;  ///< 0 where the file does not say
};

/// A value of the file for one of its elements: `origin`, `xyz`, "0 0 1".
struct UrdfValue {
  std::string element, attribute, value;
};

/// Hands the values of one joint to urdfdom. Nothing but printable characters without <, >, & and quotes is handed on,
/// so that its XML parser sees no text that this program did not write. Error: MA189 with what urdfdom says. Threads:
/// one at a time, as the messages of urdfdom go through a handler of the process, which is put back.
Result<UrdfJoint> joint_by_urdfdom(const std::string& type, const std::vector<UrdfValue>& values, const Place& place,
                                   const std::string& name);

}  // namespace polypod::machine
