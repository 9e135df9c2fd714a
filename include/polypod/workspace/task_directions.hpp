// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Which directions a workspace may ask of a task.
#pragma once

#include <fmt/format.h>

#include <array>
#include <optional>
#include <string_view>

#include "polypod/core/error.hpp"
#include "polypod/machine/parts.hpp"
#include "polypod/workspace/volume.hpp"

namespace polypod::workspace {

/// Whether a task chooses the direction of the tool at a place.
inline bool tilts(const machine::Task& task) {
  return task.places() && task.holds(machine::Coordinate::a) && task.holds(machine::Coordinate::b);
}

/// Errors: WS104 (directions that the task does not hold), WS106 (a task that has no volume).
inline Status held_by(const machine::Task& task, std::string_view name, const Directions& d) {
  if (!task.places() && task.size() != 3) {
    return fail("WS106", fmt::format("{}: a task of {} coordinates without x, y, z has no volume", name, task.size()),
                {}, "workspaces are for tasks that hold x, y, z, or three coordinates in all");
  }
  const auto asks = [](const std::optional<std::array<double, 2>>& range) {
    return range && *range != std::array<double, 2>{0, 0};
  };
  const auto holds = [&](machine::Coordinate angle) { return task.places() && task.holds(angle); };
  if ((d.tilt != 0 && !tilts(task)) || (asks(d.a_range) && !holds(machine::Coordinate::a)) ||
      (asks(d.b_range) && !holds(machine::Coordinate::b))) {
    return fail("WS104",
                fmt::format("{} cannot choose the tilt of its tool: the task does not contain the angles", name), {},
                "leave out the tilt and the ranges of A and B");
  }
  return {};
}

}  // namespace polypod::workspace
