// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "machine_lines.hpp"

#include "polypod/core/units.hpp"
#include "polypod/kinematics/parts.hpp"

namespace polypod::pages {

using report::Colour;
using report::Line3;
using report::Point3;

std::vector<Line3> machine_lines(const machine::AnyMachine& machine, const Vec3& tip) {
  return lines_of(kinematics::outline(machine, tip));
}

std::vector<Line3> lines_of(const machine::Outline& outline) {
  using Role = machine::OutlinePart::Role;
  constexpr double kThick = 2.6, kThin = 1.5, kDot = 2.8;  // px
  const auto colour = [](Role role) {
    switch (role) {
      case Role::fixed:
        return Colour::muted;
      case Role::platform:
        return Colour::blue;
      case Role::tool:
        return Colour::vermillion;
      case Role::moving:
      case Role::joints:
        break;
    }
    return Colour::ink;
  };
  std::vector<Line3> out;
  for (const machine::OutlinePart& part : outline) {
    const bool dots = part.role == Role::joints;
    Line3 line{part.name, {}, colour(part.role), dots ? kDot : part.thick ? kThick : kThin, dots};
    for (const Vec3& p : part.points)
      line.points.push_back({units::to_mm(p.x()), units::to_mm(p.y()), units::to_mm(p.z())});
    out.push_back(std::move(line));
  }
  return out;
}

void hang(report::Scene& scene) {
  const auto turn = [](Point3& p) { p = {p.x, -p.y, -p.z}; };
  for (Line3& line : scene.lines) {
    for (Point3& p : line.points) turn(p);
    for (Point3& p : line.offset) turn(p);
  }
  for (report::Mesh& mesh : scene.meshes) {
    for (Point3& p : mesh.points) turn(p);
    turn(mesh.shifts.along);
  }
  for (report::Frames& frames : scene.frames)
    for (auto& points : frames.points)
      for (Point3& p : points) turn(p);
  scene.axes = {"x", "−y", "−z"};
}

}  // namespace polypod::pages
