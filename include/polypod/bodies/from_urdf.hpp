// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A file of bodies from what a URDF file says of its links.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "polypod/core/error.hpp"

namespace polypod::bodies {

struct BodiesFile {
  std::string text;  ///< that `read` takes (docs/bodies.md)
  int count = 0;     ///< of bodies
  /// What is left out and why: a mesh that is not there, no STL file, not closed, or of another scale than m, mm, inch.
  std::vector<std::string> notes;
};

/// The bodies of the links of the chain of machine::arm_from_urdf, and of what fixed joints join to them: for each link
/// its collision elements, else its visual ones, for a file `output`, beside which meshes are named.
/// `package://NAME/PATH` is looked for beside the URDF file and in the folders above it: NAME/PATH there, or PATH where
/// the folder is called NAME.
/// Errors: those of arm_from_urdf; MA192 (a geometry or a number of it that is none); BO120 (no body can be written,
/// which it explains).
Result<BodiesFile> file_from_urdf(std::string_view text, const std::string& name, const std::string& output);

}  // namespace polypod::bodies
