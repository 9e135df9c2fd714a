// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Serial arms from URDF, the Unified Robot Description Format of ROS (XML, m, rad).
#pragma once

#include <string>
#include <string_view>

#include "polypod/core/error.hpp"
#include "polypod/families/serial/machine.hpp"

namespace polypod::machine {

/// What names a machine: `arm.urdf`, or `arm.urdf#TIP`, or `arm.urdf#BASE:TIP`, BASE and TIP being links.
struct UrdfName {
  std::string file;       ///< the name without what follows `.urdf#`
  std::string base, tip;  ///< empty where they are not given
};
UrdfName urdf_name(const std::string& name);
/// The file that a machine's name leads to: the name itself if there is such a file, else without the links.
std::string file_of_machine(const std::string& name);

/// Whether a text is to be read as URDF: it begins as XML does, or the name of its file ends in `.urdf`, `.xacro` or
/// `.xml`.
bool is_urdf(std::string_view text, const std::string& name);

/// The entry of the provenance that says which link is the flange, from which robots' controllers count the tool, and
/// how it begins where the file does not tell.
inline constexpr const char* kFlange = "flange";
inline constexpr const char* kNotKnown = "not known";

/// The chain of a URDF file from a base to a tip as a serial arm. {M} is the frame of the base link, and {T} that of
/// the tip link, turned by 180 deg about its x axis: z of a tool frame of ROS points away from the flange, z_T towards
/// it.
///
/// The base is BASE, else the root of the tree. The tip is TIP, else the only link that is called `tool0` (else ends in
/// `_tool0`), else the only end of the tree that a moving joint moves. Joints of the chain are revolute, continuous
/// (one turn each way), prismatic or fixed; a joint counts about (along) its axis. The table follows from the axes
/// (arm_of_axes). The task is usual_task(). An angle of `rpy` with four decimals at least that is a multiple of 15 deg
/// but for its last digit is that multiple: 1.5708 is 90 deg. What is changed so, the names of the joints, speeds, and
/// what is not read (inertia, bodies) stand in `provenance`.
///
/// urdfdom judges each joint of the chain; tree, chain and text are checked before. Errors: MA180 to MA191,
/// docs/errors.md.
Result<SerialArm> arm_from_urdf(std::string_view text, const std::string& name);

}  // namespace polypod::machine
