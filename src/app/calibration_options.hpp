// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the commands about measurements have in common.
#pragma once

#include <string>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/geometry/pose.hpp"

namespace polypod::app {

inline constexpr const char* kFrameHelp =
    "x,y,z[,A,B,C] in mm and deg: M in the instrument's frame (default: the same)";
inline constexpr const char* kTargetHelp =
    "x,y,z[,A,B,C] in mm and deg: the target (reflector, ball) in the tool's frame (default: the tip)";

/// A frame of an option: x, y, z and perhaps A, B, C, mm and deg; the identity for an empty text. Errors: AP160.
Result<Pose> frame_argument(const std::string& text, const char* option);
/// Points of a repeated option, x,y,z in mm each. Errors: AP160.
Result<std::vector<Vec3>> points_of(const std::vector<std::string>& texts, const char* option);

}  // namespace polypod::app
