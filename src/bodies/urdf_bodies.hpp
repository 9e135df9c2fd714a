// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The bodies that a URDF file gives the links of an arm.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/geometry/pose.hpp"

namespace polypod::bodies {

/// A body of a link, as the file has it: a box, cylinder (along z) or sphere about its origin, or a mesh.
struct UrdfBody {
  enum class Shape { box, cylinder, sphere, mesh };
  std::string link;
  bool visual = false;  ///< what is to be seen, for want of a body for collisions
  int row = 0;          ///< the row of the arm's table after which it moves; 0: the base
  Pose X;               ///< its frame in that of the row (of row 0: of the arm's base)
  Shape shape = Shape::box;
  Vec3 size = Vec3::Zero();  ///< m: edges of a box; radius and length
  std::string file;          ///< of a mesh, as written
  Vec3 scale = Vec3::Ones();
};
/// Those of the links of the chain of machine::arm_from_urdf, and of what fixed joints join to them: for each link its
/// collision elements, else its visual ones. Errors: those of arm_from_urdf; MA192 (a geometry or a number of it
/// that is none).
Result<std::vector<UrdfBody>> bodies_from_urdf(std::string_view text, const std::string& name);

}  // namespace polypod::bodies
