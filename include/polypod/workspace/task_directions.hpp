// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Which points a workspace has of a task, and which directions it may ask of it.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <numbers>
#include <optional>
#include <string>
#include <string_view>

#include "polypod/core/error.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/machine/parts.hpp"
#include "polypod/workspace/volume.hpp"

namespace polypod::workspace {

/// How many coordinates a point of a workspace has: x, y, z; of a task that does not hold them as many as it has, at
/// most 3. What is left of a Vec3 runs from -kAcross to kAcross and says nothing, so that an area is a volume.
inline int coordinates_of_points(const machine::Task& task) {
  return task.places() ? 3 : std::min(task.size(), 3);
}
inline constexpr double kAcross = 0.5;

/// The pose at a point of a workspace: the tool at `point` of M in the orientation R. Points of a task that does not
/// hold x, y, z are its coordinates, m and rad, which say the orientation too.
inline Pose pose_at(const machine::Task& task, const Mat3& R, const Vec3& point) {
  return task.places() ? Pose{R, point} : kinematics::pose_of(task, {point.x(), point.y(), point.z()});
}
/// The point at which a pose lies.
inline Vec3 point_of(const machine::Task& task, const Pose& X) {
  if (task.places()) return X.p;
  std::vector<double> c = kinematics::coordinates_of(task, X);
  c.resize(3);
  return {c[0], c[1], c[2]};
}

/// How far from home the angles of such points go, rad: a turn more is the same pose.
inline constexpr double kFromHome = std::numbers::pi / 2;

/// The unit in which a person reads a coordinate of a task's points, "mm" or "deg".
inline const char* unit_of(const machine::Task& task, int coordinate) {
  return !task.places() && task.is_angle(coordinate) ? "deg" : "mm";
}
/// That of the coordinate along which a step of a grid runs.
inline const char* unit_along(const machine::Task& task, const Vec3& step) {
  Eigen::Index coordinate = 0;
  step.cwiseAbs().maxCoeff(&coordinate);
  return unit_of(task, static_cast<int>(coordinate));
}
/// A point in these units.
inline Vec3 for_user(const machine::Task& task, const Vec3& point) {
  Vec3 out;
  for (int k = 0; k < 3; ++k) out[k] = units::to_user(point[k], unit_of(task, k));
  return out;
}
/// What a coordinate is called: "x", "A".
inline std::string coordinate_name(const machine::Task& task, int coordinate) {
  return machine::name_of(task.places() ? machine::Task::point[coordinate] : task[coordinate]);
}
/// What a column of it is called: "x_mm", "a_deg".
inline std::string column_name(const machine::Task& task, int coordinate) {
  return fmt::format("{:c}_{}", std::tolower(coordinate_name(task, coordinate)[0]), unit_of(task, coordinate));
}

/// Whether a task chooses the direction of the tool at a place.
inline bool tilts(const machine::Task& task) {
  return task.places() && task.holds(machine::Coordinate::a) && task.holds(machine::Coordinate::b);
}

/// Whether the angles of a box of points of a task without x, y, z are within kFromHome of home: workspaces go no
/// farther. Errors: WS130.
Status near_home(const machine::AnyMachine& machine, const Vec3& low, const Vec3& high);

/// Errors: WS104 (directions that the task does not hold), WS106 (a task that has no measure).
inline Status held_by(const machine::Task& task, std::string_view name, const Directions& d) {
  if (!task.places() && task.size() > 3) {
    return fail("WS106",
                fmt::format("{}: workspaces of {} coordinates without x, y, z are not known", name, task.size()), {},
                "workspaces are for tasks that hold x, y, z, or one to three coordinates in all");
  }
  const auto asks = [](const std::optional<std::array<double, 2>>& range) {
    return range && *range != std::array<double, 2>{0, 0};
  };
  if (!task.places() && task.turns() && (d.tilt != 0 || asks(d.a_range) || asks(d.b_range))) {
    return fail("WS104",
                fmt::format("{}: angles are coordinates of its workspace, which holds every one there is", name), {},
                "leave out the tilt and the ranges of A and B; a --box ends the angles");
  }
  const auto holds = [&](machine::Coordinate angle) { return task.holds(angle); };
  if ((d.tilt != 0 && !tilts(task)) || (asks(d.a_range) && !holds(machine::Coordinate::a)) ||
      (asks(d.b_range) && !holds(machine::Coordinate::b))) {
    return fail("WS104",
                fmt::format("{} cannot choose the tilt of its tool: the task does not contain the angles", name), {},
                "leave out the tilt and the ranges of A and B");
  }
  return {};
}

}  // namespace polypod::workspace
