// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the parts of this room share.
#pragma once

#include <fmt/format.h>

#include <limits>
#include <string>

#include "polypod/core/units.hpp"
#include "polypod/geometry/pose.hpp"

namespace polypod::cell {

inline constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// A place as problems name it.
inline std::string place_text(const Vec3& p) {
  return fmt::format("{:.0f}, {:.0f}, {:.0f} mm", units::to_mm(p.x()), units::to_mm(p.y()), units::to_mm(p.z()));
}

}  // namespace polypod::cell
