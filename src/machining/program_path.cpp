// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/program_path.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "polypod/gcode/unroll.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/machining/job.hpp"
#include "polypod/machining/tilted.hpp"

namespace polypod::machining {
namespace {

/// Shorter moves and smaller turns are none, m and rad.
constexpr double kNone = 1e-9;

/// The unit vectors of an arc's plane, right-handed with its normal.
std::array<int, 3> axes_of(gcode::Plane plane) {
  if (plane == gcode::Plane::zx) return {2, 0, 1};
  if (plane == gcode::Plane::yz) return {1, 2, 0};
  return {0, 1, 2};
}

motion::Stretch stretch_of(const gcode::Move& move, const Pose& X_MW) {
  motion::Stretch out;
  out.length = move.length();
  out.from = X_MW * move.start;
  out.to = X_MW * move.end;
  if (move.kind == gcode::MoveKind::arc && out.length > kNone) {
    const auto axes = axes_of(move.plane);
    const Vec3 normal = Vec3::Unit(axes[2]);
    Vec3 from = move.start - move.centre, to = move.end - move.centre;
    const double rise = to.dot(normal) - from.dot(normal);
    from -= from.dot(normal) * normal;
    to -= to.dot(normal) * normal;
    out.curve = motion::Stretch::Curve::arc;
    out.center = X_MW * move.centre;
    out.radius = from.norm();
    out.radius_end = to.norm();
    out.sweep = move.sweep;
    const Vec3 u = from.normalized(), v = (move.clockwise ? -1.0 : 1.0) * normal.cross(u);
    out.u = X_MW.R * u;
    out.v = X_MW.R * v;
    out.rise = X_MW.R * (rise * normal);
  }
  return out;
}

}  // namespace

Result<ProgramPath> path_of_program(const machine::AnyMachine& machine, const Pose& X_MW, const gcode::Program& program,
                                    const gcode::Interpretation& interpretation, double rapid_speed,
                                    bool block_delete) {
  POLYPOD_TRY(follows_programs(machine));
  const machine::Task task = kinematics::task(machine);
  ProgramPath out;
  out.notes = interpretation.notes;
  std::vector<motion::Stretch> stretches;
  const auto known = [](const std::array<bool, 3>& k) { return k[0] && k[1] && k[2]; };
  // Dwells in the order of the blocks: each belongs to the move before it.
  std::size_t block = 0;
  double before = 0;
  const auto wait_until = [&](std::size_t end) {
    for (; block < end; ++block) {
      const gcode::Block b = program.blocks[block];
      if (b.after_end || (b.optional && block_delete)) continue;
      const double wait = gcode::dwell_of(b);
      (stretches.empty() ? before : stretches.back().wait) += wait;
      out.wait += wait;
    }
  };
  for (const gcode::Move& move : interpretation.moves) {
    const int line = program.blocks[static_cast<std::size_t>(move.block)].line;
    wait_until(static_cast<std::size_t>(move.block));
    if (!move.start_known || !known(move.known_end)) {
      out.left_out.push_back(line);
      continue;
    }
    motion::Stretch s = stretch_of(move, X_MW);
    const double turned = (move.axes_end - move.axes_start).norm();
    if (!(s.length > kNone)) s.length = 0;
    s.size = s.length > 0 ? s.length : turned;
    if (!(s.size > kNone)) continue;
    s.angles_from = move.axes_start;
    s.angles_to = move.axes_end;
    // A and B of a 5-axis machine are its own axes, and C counts from M: only a tilt turns with the workpiece.
    const bool tilts = !move.axes_start.head<2>().isZero(0) || !move.axes_end.head<2>().isZero(0);
    if (!task.names_axis() && tilts && !X_MW.R.isIdentity(kNone)) {
      const auto in_M = [&](const Vec3& axes) { return angles_abc(tool_orientation(machine, X_MW, axes)); };
      s.angles_from = in_M(move.axes_start);
      s.angles_to = in_M(move.axes_end);
      for (int k = 0; k < 3; ++k) {  // the short way from one to the other
        const double turn = 2 * std::numbers::pi;
        s.angles_to[k] += turn * std::round((s.angles_from[k] - s.angles_to[k]) / turn);
      }
    }
    s.rapid = move.kind == gcode::MoveKind::rapid;
    s.speed = s.rapid ? rapid_speed : move.feed;
    s.line = line;
    s.stop = move.path.mode == gcode::PathMode::exact_stop;
    if (stretches.empty()) s.wait_before = before;
    stretches.push_back(s);
  }
  wait_until(program.blocks.size());
  if (stretches.empty()) {
    return fail("MO117", "the program makes no move of which both ends are known", {},
                "give X, Y and Z with G0 before the first move that counts");
  }
  POLYPOD_ASSIGN(path, motion::pose_path_of(std::move(stretches)));
  out.path = std::move(path);
  return out;
}

}  // namespace polypod::machining
