// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The path of poses that a program sends the tool along.
#pragma once

#include <string>
#include <vector>

#include "polypod/gcode/interpreter.hpp"
#include "polypod/machine/any_machine.hpp"
#include "polypod/motion/pose_path.hpp"

namespace polypod::machining {

struct ProgramPath {
  motion::PosePath path;
  /// Lines whose moves begin or end where X, Y and Z are not known: they are left out.
  std::vector<int> left_out;
  double wait = 0;  ///< s, of all dwells (G4) that stand in the path
  std::vector<std::string> notes;
};

/// The moves of a program in M, one stretch each: lines, arcs, helices and turns on the spot, with their lines, feeds
/// as the largest speed of the tip, and `rapid_speed` (m/s) for G0. A, B and C go linearly with the way. Under G61.1
/// the tool stops behind each move, and waits where a dwell (G4) stands; with `block_delete`, blocks that begin with
/// `/` are none. `X_MW` is where the work is. Errors: MC309, MO117 (no move whose ends are known).
Result<ProgramPath> path_of_program(const machine::AnyMachine& machine, const Pose& X_MW, const gcode::Program& program,
                                    const gcode::Interpretation& interpretation, double rapid_speed, bool block_delete);

}  // namespace polypod::machining
