// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Programs that cut with a tilted tool: 3 + 2 axes.
#pragma once

#include <string>

#include "polypod/gcode/interpreter.hpp"
#include "polypod/machining/job.hpp"

namespace polypod::machining {

/// The orientation of the tool in M with the rotary axes (A, B, C, rad) of a program: R_y(B) R_x(A) of a machine whose
/// A and B are its own axes (Task::names_axis), else R_MW R_z(C) R_y(B) R_x(A) R_MW^T: where the workpiece is turned
/// about z the axis of the tool turns with it, and C counts from M all the same, as controllers take it.
Mat3 tool_orientation(const machine::AnyMachine& machine, const Pose& X_MW, const Vec3& axes);
Mat3 tool_orientation(const Job& job, const Vec3& axes);
/// That of every cut of the job: tool_frame where the tool is tilted, else with A = B = C = 0.
Mat3 cutting_orientation(const Job& job);

/// Whether the tool cannot touch the stock of the job on a move, however long it is above its tip: a face of the box
/// round the stock parts them. That holds where the disc at the tip stays beyond the face on the whole way and the axis
/// never leans to the face's other side; turns are looked at every half degree, which leaves a tool of 1 m open by 10
/// um. False says nothing. Coordinates that are not known: of the start of a rapid they do not count (it comes from
/// where the machine stood), else no face across them parts.
bool stays_clear(const Job& job, const gcode::Move& move);

/// Sets the job up for the orientation of the tool that all cuts of the program share: Job::tool_frame, and the stock
/// in its frame (cutting::turned_block). A job of a program that cuts with A = B = C = 0, or that the machine cannot
/// turn for, stays as it is. What may cut: feed moves that do not stay clear.
///
/// Errors, with the line: MC206 the tool turns in a move that may cut; MC207 moves that may cut have several
/// orientations, of which none is carried over to the other; MC208 a measured compliance, which holds for a tool along
/// z of M; MC209 a stock that is not a whole block; CT111 of its cells.
Status set_up(Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation);

/// Error: MC204 for the first feed move that may cut in another orientation than the job is set up for.
Status stands_as_set_up(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation);

/// Whether a move has the orientation for which the job is set up, at its start and at its end.
bool stands_as_set_up(const Job& job, const gcode::Move& move);

/// "A 20 B 0 deg", and C where the machine turns it or it is not 0.
std::string orientation_in_words(const Vec3& axes);

}  // namespace polypod::machining
