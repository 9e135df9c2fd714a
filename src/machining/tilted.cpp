// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/tilted.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "polypod/cutting/ball_stock.hpp"
#include "polypod/cutting/turned_block.hpp"
#include "polypod/gcode/writer.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/posture.hpp"
#include "polypod/machining/simulate.hpp"

namespace polypod::machining {
namespace {

// Turns of A, B or C below this are none, rad.
constexpr double kNoTurn = 1e-9;
// Turns are looked at as often as this, rad.
constexpr double kTurnStep = units::from_deg(0.5);

bool same(const Vec3& a, const Vec3& b) {
  return (a - b).isZero(kNoTurn);
}

bool turns(const gcode::Move& move) {
  return !same(move.axes_start, move.axes_end);
}

Place place_of(const gcode::Program& program, const gcode::Move& move) {
  return {program.path, program.blocks[static_cast<std::size_t>(move.block)].line, 1};
}

Eigen::AlignedBox3d stock_box(const Job& job) {
  return job.tool_frame.tilted ? job.tool_frame.stock_in_W : Eigen::AlignedBox3d(job.stock.min(), job.stock.max());
}

/// Where the tip passes along one axis of W.
struct Range {
  double low, high;
};
Range tip_along(const gcode::Move& move, int k, bool start) {
  Range out{move.end[k], move.end[k]};
  if (start) out = {std::min(out.low, move.start[k]), std::max(out.high, move.start[k])};
  if (move.kind == gcode::MoveKind::arc) {
    const int normal = move.plane == gcode::Plane::xy ? 2 : move.plane == gcode::Plane::zx ? 1 : 0;
    if (k != normal) {
      const double r = std::max((move.start - move.centre).norm(), (move.end - move.centre).norm());
      out = {std::min(out.low, move.centre[k] - r), std::max(out.high, move.centre[k] + r)};
    }
  }
  return out;
}

bool is_feed(const gcode::Move& move) {
  return move.kind != gcode::MoveKind::rapid && (move.length() > 0 || turns(move));
}

/// The largest angle between the tool axis and z of W on a move, rad.
double largest_tilt(const Job& job, const gcode::Move& move) {
  const double turn = (move.axes_end - move.axes_start).cwiseAbs().maxCoeff();
  const int steps = std::max(1, static_cast<int>(std::ceil(turn / kTurnStep)));
  double most = 0;
  for (int i = 0; i <= steps; ++i) {
    const Vec3 at = move.axes_start + double(i) / steps * (move.axes_end - move.axes_start);
    const Vec3 axis = job.X_MW.R.transpose() * tool_orientation(job, at).col(2);
    most = std::max(most, std::acos(std::clamp(axis.z(), -1.0, 1.0)));
  }
  return most;
}

/// For balls that turn in cuts, or cut in several orientations; `may_cut`: the moves that may.
Status set_up_turning(Job& job, const gcode::Program& program, const std::vector<const gcode::Move*>& may_cut) {
  for (const gcode::Move* one : may_cut) {
    const gcode::Move& move = *one;
    if (!cutting::is_ball(job.cutter_of(move.tool))) continue;
    const auto tilted = [](const Vec3& axes) { return !axes.isZero(kNoTurn); };
    if (job.measured && (tilted(move.axes_start) || tilted(move.axes_end))) {
      return fail("MC208",
                  fmt::format("the tool cuts at {}, and the measured compliance holds for a tool along z of M",
                              orientation_in_words(move.axes_end)),
                  place_of(program, move), "leave measured_compliance and --measured out, and take that of the joints");
    }
    if (!(move.length() > 0)) {
      return fail("MC206",
                  fmt::format("the tool turns on the spot from {} to {} where it may cut",
                              orientation_in_words(move.axes_start), orientation_in_words(move.axes_end)),
                  place_of(program, move), "what only turns the tool goes above the stock");
    }
    if (const double tilt = largest_tilt(job, move); tilt > kLargestTilt) {
      return fail("MC213",
                  fmt::format("the tool is tilted by {:.1f} deg against z of the workpiece in a cut; up to {:g} deg "
                              "are known",
                              units::to_deg(tilt), units::to_deg(kLargestTilt)),
                  place_of(program, move), "set the part up so that the tool is tilted less");
    }
  }
  job.tool_frame = ToolFrame{};
  job.tool_frame.turns = true;
  return {};
}

}  // namespace

Mat3 tool_orientation(const machine::AnyMachine& machine, const Pose& X_MW, const Vec3& axes) {
  const machine::Task task = kinematics::task(machine);
  if (task.names_axis()) return rotation_abc(axes.x(), axes.y(), 0.0);
  const Mat3 R = rotation_abc(axes.x(), axes.y(), task.holds(machine::Coordinate::c) ? axes.z() : 0.0);
  return X_MW.R * R * X_MW.R.transpose();
}
Mat3 tool_orientation(const Job& job, const Vec3& axes) {
  return tool_orientation(job.machine, job.X_MW, axes);
}

bool may_turn_the_part(const machine::AnyMachine& machine, const gcode::Interpretation& interpretation) {
  return !kinematics::task(machine).names_axis() ||
         std::all_of(interpretation.moves.begin(), interpretation.moves.end(), [](const gcode::Move& move) {
           return move.axes_end.head<2>().isZero(kNoTurn) && move.axes_start.head<2>().isZero(kNoTurn);
         });
}

void put(Job& job, const Pose& X_MW) {
  job.X_MW = X_MW;
  if (job.tool_frame.tilted) job.tool_frame.R_MT = tool_orientation(job, job.tool_frame.axes);
}
Mat3 cutting_orientation(const Job& job) {
  return job.tool_frame.tilted ? job.tool_frame.R_MT : tool_orientation(job, Vec3::Zero());
}

Vec3 axes_at(const gcode::Move& move, double s) {
  if (!turns(move)) return move.axes_end;
  const double length = move.length();
  const double share = length > 0 ? std::clamp(s / length, 0.0, 1.0) : 1.0;
  return move.axes_start + share * (move.axes_end - move.axes_start);
}
Mat3 cutting_orientation(const Job& job, const Vec3& axes) {
  return job.tool_frame.turns ? tool_orientation(job, axes) : cutting_orientation(job);
}

std::optional<machine::JointVector> joints_at(const Job& job, const Pose& X_MT) {
  const kinematics::InverseResult inverse = kinematics::inverse(job.machine, X_MT);
  const kinematics::Solution* s = kinematics::reachable_in(job.machine, inverse, job.posture);
  return s == nullptr ? std::nullopt : std::optional(s->joints);
}

std::optional<machine::JointVector> joints_at(const Job& job, const Pose& X_MT, const Sample& sample) {
  if (sample.joint_count == 0) return joints_at(job, X_MT);
  const kinematics::InverseResult near = kinematics::inverse_near(job.machine, X_MT, sample.came_with());
  const kinematics::Solution* s = near.reachable();
  return s == nullptr ? std::nullopt : std::optional(s->joints);
}

std::string posture_at_start(const Job& job, const gcode::Move& move) {
  const Pose X_MT{cutting_orientation(job, move.axes_start), job.X_MW * move.start};
  const kinematics::InverseResult inverse = kinematics::inverse(job.machine, X_MT);
  const kinematics::Solution* s = kinematics::reachable_in(job.machine, inverse, job.posture);
  if (s == nullptr || s->branch >= kinematics::kNumericBranch) return {};
  std::string name = kinematics::branch_name(job.machine, s->branch);
  return name == "only" ? std::string() : name;
}

Vec3 middle_beside_tip(const Job& job, const gcode::Move& programmed, const Vec3& tip, const Vec3& axes) {
  if (!job.tool_frame.turns || !cutting::is_ball(job.cutter_of(programmed.tool))) return Vec3::Zero();
  const Vec3 meant = axes_at(programmed, programmed.nearest(tip));
  if (meant == axes) return Vec3::Zero();
  const Vec3 apart = tool_orientation(job, axes).col(2) - tool_orientation(job, meant).col(2);
  return job.cutter_of(programmed.tool).radius() * (job.X_MW.R.transpose() * apart);
}

std::string orientation_in_words(const Vec3& axes) {
  const auto deg = [](double x) { return gcode::number(units::to_deg(x), 4); };
  std::string out = fmt::format("A {} B {}", deg(axes.x()), deg(axes.y()));
  if (std::abs(axes.z()) > kNoTurn) out += fmt::format(" C {}", deg(axes.z()));
  return out + " deg";
}

bool stands_as_set_up(const Job& job, const gcode::Move& move) {
  if (job.tool_frame.turns && cutting::is_ball(job.cutter_of(move.tool))) return true;
  return same(move.axes_start, job.tool_frame.axes) && same(move.axes_end, job.tool_frame.axes);
}

bool stays_clear(const Job& job, const gcode::Move& move) {
  const Eigen::AlignedBox3d box = stock_box(job);
  const double radius = job.cutter_of(move.tool).radius();
  const double turn = (move.axes_end - move.axes_start).cwiseAbs().maxCoeff();
  const int steps = std::max(1, static_cast<int>(std::ceil(turn / kTurnStep)));
  std::vector<Vec3> axes;  // of the tool, in W
  for (int i = turn > kNoTurn ? 0 : steps; i <= steps; ++i) {
    const Vec3 at = move.axes_start + double(i) / steps * (move.axes_end - move.axes_start);
    axes.push_back(job.X_MW.R.transpose() * tool_orientation(job, at).col(2));
  }
  constexpr double kAlong = 1e-9;  // an axis that leans by less than this lies in the face
  for (int k = 0; k < 3; ++k) {
    const bool start = move.known_start[static_cast<std::size_t>(k)];
    if (!move.known_end[static_cast<std::size_t>(k)]) continue;
    if (!start && move.kind != gcode::MoveKind::rapid) continue;
    const Range tip = tip_along(move, k, start);
    for (const double side : {1.0, -1.0}) {
      const double beyond = side > 0 ? tip.low - box.max()[k] : box.min()[k] - tip.high;
      if (std::all_of(axes.begin(), axes.end(), [&](const Vec3& axis) {
            const double leans = side * axis[k];
            return leans >= -kAlong && beyond >= radius * std::sqrt(std::max(0.0, 1 - leans * leans)) - kAlong;
          })) {
        return true;
      }
    }
  }
  return false;
}

Status stands_as_set_up(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation) {
  for (const gcode::Move& move : interpretation.moves) {
    if (!is_feed(move) || stands_as_set_up(job, move) || stays_clear(job, move)) continue;
    const Vec3& other = same(move.axes_end, job.tool_frame.axes) ? move.axes_start : move.axes_end;
    const machine::Task task = kinematics::task(job.machine);
    for (int k = 0; k < 3; ++k) {
      if (std::abs(other[k]) < kNoTurn || task.holds(static_cast<machine::Coordinate>(3 + k))) continue;
      return fail(
          "MC204",
          fmt::format("{} {:g} deg in a cut: this machine has no {}", "ABC"[k], units::to_deg(other[k]), "ABC"[k]),
          place_of(program, move), "leave the word out, or take a machine that has this axis");
    }
    if (!job.tool_frame.tilted) {
      return fail("MC204", "the tool is tilted in a cut; the stock is a height map and knows only A = B = C = 0",
                  place_of(program, move),
                  "predict, correct, compare and place take programs whose cuts all have one orientation, and balls "
                  "that turn; else set the part up so that the tool is vertical in each cut");
    }
    return fail("MC204",
                fmt::format("the tool is at {} in what may be a cut; the other cuts have {}",
                            orientation_in_words(other), orientation_in_words(job.tool_frame.axes)),
                place_of(program, move), "one program for each orientation, and turns above the stock");
  }
  return {};
}

Status set_up(Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation) {
  const machine::Task task = kinematics::task(job.machine);
  bool any = false;
  for (const gcode::Move& move : interpretation.moves) {
    for (int k = 0; k < 3; ++k) {
      if (std::abs(move.axes_end[k]) < kNoTurn) continue;
      if (!task.holds(static_cast<machine::Coordinate>(3 + k))) return {};  // `accept` names it
      any = true;
    }
  }
  if (!any) return {};

  struct Seen {
    Vec3 axes;
    const gcode::Move* first;
  };
  std::vector<Seen> seen;
  std::vector<const gcode::Move*> may_cut;
  const gcode::Move* turning = nullptr;
  const gcode::Move* tilted_cylinder = nullptr;
  for (const gcode::Move& move : interpretation.moves) {
    if (!is_feed(move) || stays_clear(job, move)) continue;
    may_cut.push_back(&move);
    if (turns(move) && turning == nullptr) turning = &move;
    const bool upright = move.axes_start.isZero(kNoTurn) && move.axes_end.isZero(kNoTurn);
    if (!upright && tilted_cylinder == nullptr && !cutting::is_ball(job.cutter_of(move.tool))) tilted_cylinder = &move;
    const bool known =
        std::any_of(seen.begin(), seen.end(), [&](const Seen& s) { return same(s.axes, move.axes_end); });
    if (!known) seen.push_back({move.axes_end, &move});
  }
  // A block is seen along the tool where all cuts have one orientation; else balls turn over what there is.
  const bool one = turning == nullptr && seen.size() <= 1;
  if (!one || (!seen.empty() && !seen[0].axes.isZero(kNoTurn) && !cutting::is_block(job.stock))) {
    if (tilted_cylinder == nullptr) return set_up_turning(job, program, may_cut);
    if (turning != nullptr && cutting::is_ball(job.cutter_of(turning->tool))) {
      return fail("MC206",
                  fmt::format("the tool is at {} in a move that may cut, and is no ball end mill; in line {} a ball "
                              "turns in a cut",
                              orientation_in_words(tilted_cylinder->axes_end), place_of(program, *turning).line),
                  place_of(program, *tilted_cylinder),
                  "beside a ball that turns other tools are at zero tilt in their cuts");
    }
  }
  if (turning != nullptr) {
    return fail("MC206",
                fmt::format("the tool turns from {} to {} in a move that may cut",
                            orientation_in_words(turning->axes_start), orientation_in_words(turning->axes_end)),
                place_of(program, *turning),
                "cuts need one orientation of the tool, or a ball end mill (corner_radius_mm of half its diameter); "
                "what only turns the tool goes above the stock");
  }
  if (seen.size() > 1) {
    const int before = place_of(program, *seen[0].first).line;
    return fail("MC207",
                fmt::format("here the tool may cut at {}, and from line {} on at {}: the stock is a height map along "
                            "one of them, and what is cut is not carried over to another",
                            orientation_in_words(seen[1].axes), before, orientation_in_words(seen[0].axes)),
                place_of(program, *seen[1].first),
                "one program for each orientation, each with the stock that it meets, or a ball end mill "
                "(corner_radius_mm of half its diameter)");
  }
  if (seen.empty() || seen[0].axes.isZero(kNoTurn)) return {};
  const gcode::Move& first = *seen[0].first;
  if (job.measured) {
    return fail("MC208",
                fmt::format("the tool cuts at {}, and the measured compliance holds for a tool along z of M",
                            orientation_in_words(seen[0].axes)),
                place_of(program, first), "leave measured_compliance and --measured out, and take that of the joints");
  }
  if (!cutting::is_block(job.stock)) {
    return fail(
        "MC209",
        fmt::format("the tool cuts at {}, and the stock is no whole block: only that can be seen along a tilted "
                    "tool",
                    orientation_in_words(seen[0].axes)),
        place_of(program, first), "give the stock as kind = \"block\", or take a ball end mill");
  }
  ToolFrame tool;
  tool.tilted = true;
  tool.axes = seen[0].axes;
  tool.R_MT = tool_orientation(job, tool.axes);
  // The stock is seen along the tool; how the tool is turned about its axis is nothing to it.
  tool.R_WS = kinematics::task(job.machine).names_axis() ? Mat3(job.X_MW.R.transpose() * tool.R_MT)
                                                         : rotation_abc(tool.axes.x(), tool.axes.y(), tool.axes.z());
  tool.stock_in_W = {job.stock.min(), job.stock.max()};
  POLYPOD_ASSIGN(stock,
                 cutting::turned_block(job.stock.min(), job.stock.max(), tool.R_WS.transpose(), job.stock.cell()));
  job.stock = std::move(stock);
  job.tool_frame = tool;
  return {};
}

}  // namespace polypod::machining
