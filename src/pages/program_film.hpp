// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A machine on its way along a program, as pictures over time.
#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "polypod/gcode/interpreter.hpp"
#include "polypod/gcode/program.hpp"
#include "polypod/machine/any_machine.hpp"
#include "polypod/report/scene.hpp"

namespace polypod::pages {

/// Where a machine is at one point of a program.
struct ProgramInstant {
  double time = 0;  ///< s, of the feed moves and the rapids, without acceleration
  int move = 0;     ///< index of the move
  double s = 0;     ///< m along it
  int line = 0;
  bool reached = false;  ///< the machine takes this pose within its limits
  Pose X;                ///< that is asked for, in M
  /// Of the solution nearest to the joints before: the one within the limits, or else the first; empty: there is none.
  machine::JointVector q;
  std::string why;  ///< the limits that are broken, or why there is no solution; empty where it is reached
};

struct ProgramWalk {
  std::vector<ProgramInstant> pictures;  ///< at about equal times, at every wanted place, where something goes wrong
  /// For curves: the first point of each of some thousand equal times, and where a joint is least and greatest in it.
  std::vector<ProgramInstant> curve;
  double time = 0;                 ///< s
  std::size_t moves = 0;           ///< of which both ends are known
  [[nodiscard]] bool any() const;  ///< some picture has joints
};

struct ProgramWalkOptions {
  double rapid_speed = 0.1;  ///< m/s
  double step = 1e-3;        ///< m, between points
  std::size_t pictures = 400;
  std::string posture;  ///< to begin with; empty: the first within the limits
  /// Places that get a picture whatever time it is: move and m along it, in order.
  std::vector<std::pair<int, double>> wanted;
};

/// Sends the machine along the moves as machining::check does: the joints follow the branch that they are on. Moves
/// whose start is not known take no time and have no pictures but their end. Cost: one inverse a point.
ProgramWalk walk_program(const machine::AnyMachine& machine, const Pose& X_MW, const gcode::Program& program,
                         const LongVector<gcode::Move>& moves, const ProgramWalkOptions& options);

/// What else a picture reads out beside time, line, pose and joints.
struct FilmColumn {
  std::string name, unit;
  std::function<double(const ProgramInstant&)> value;  ///< not finite: none
};

/// Puts a machine at these instants into the scene (in M, mm), with a dot at the tool tip and a row of pictures of it.
/// A machine that finds no joints stays where it was, red, and says why. `text`: what goes on at an instant; may be
/// empty. Nothing where no instant has joints.
void add_film(report::Scene& scene, const machine::AnyMachine& machine, const std::vector<ProgramInstant>& instants,
              const std::vector<FilmColumn>& columns, const std::function<std::string(const ProgramInstant&)>& text);

/// "line 12: G1 X20", for `text`.
std::function<std::string(const ProgramInstant&)> lines_of(const gcode::Program& program,
                                                           const LongVector<gcode::Move>& moves);

/// "412 pictures of 12 345 moves: one stands for 30 moves", or that every move has its own.
std::string film_in_words(const ProgramWalk& walk);

/// How many pictures of this machine about a megabyte holds.
std::size_t pictures_for(const machine::AnyMachine& machine);

/// The way of the tool in M, mm, with the lines of the program: feeds and rapids, each thinned out to about `points`
/// points, and dots where the machine does not get.
void add_way(report::Scene& scene, const Pose& X_MW, const gcode::Program& program,
             const LongVector<gcode::Move>& moves, const ProgramWalk& walk, std::size_t points);

/// The feeds or the rapids in M, mm, with the lines of the program, thinned out to about `points` points. `value`: of
/// each move, for Scene::ramp.
report::Line3 path_of(const Pose& X_MW, const gcode::Program& program, const LongVector<gcode::Move>& moves, bool rapid,
                      std::size_t points, const std::function<double(const gcode::Move&)>& value = {});

/// Leaves out points that lie near to the one before, with their tags and values, until about `points` are left; points
/// that are not finite interrupt the line and stay. A value changes where a stretch begins that is not near.
void thin_out(report::Line3& line, std::size_t points);

/// The twelve edges of a box of W (m), in M.
report::Line3 box_line(const std::string& name, const Vec3& low, const Vec3& high, const Pose& X_MW);

}  // namespace polypod::pages
