// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Programs that cut with a tilted tool (3 + 2 axes), or with one that turns while it cuts (5 axes).
#pragma once

#include <optional>
#include <string>

#include "polypod/core/units.hpp"
#include "polypod/gcode/interpreter.hpp"
#include "polypod/machining/job.hpp"

namespace polypod::machining {

struct Sample;

/// The orientation of the tool in M with the rotary axes (A, B, C, rad) of a program: R_y(B) R_x(A) of a machine whose
/// A and B are its own axes (Task::names_axis), else R_MW R_z(C) R_y(B) R_x(A) R_MW^T: where the workpiece is turned
/// about z the axis of the tool turns with it, and C counts from M all the same, as controllers take it.
Mat3 tool_orientation(const machine::AnyMachine& machine, const Pose& X_MW, const Vec3& axes);
Mat3 tool_orientation(const Job& job, const Vec3& axes);
/// Whether a program cuts the same part where the workpiece is turned about z: A and B of a machine whose own axes they
/// are (Task::names_axis) do not turn with it, and so all of them are 0.
bool may_turn_the_part(const machine::AnyMachine& machine, const gcode::Interpretation& interpretation);
/// The job with its workpiece elsewhere, as set up; turned only where may_turn_the_part.
void put(Job& job, const Pose& X_MW);
/// That of every cut of the job: tool_frame where the tool is tilted, else with A = B = C = 0.
Mat3 cutting_orientation(const Job& job);
/// A, B and C at the arc length s of a move, rad: they turn in step with the way. At its end where it has no length.
Vec3 axes_at(const gcode::Move& move, double s);
/// The orientation of the tool in M in a cut: that of all cuts, or, where the tool turns in them (ToolFrame::turns),
/// the one with these A, B and C.
Mat3 cutting_orientation(const Job& job, const Vec3& axes);
/// The joints in which the machine stands at a pose of the program: the first within the limits, in the job's posture
/// where it has one; empty where there are none.
std::optional<machine::JointVector> joints_at(const Job& job, const Pose& X_MT);
/// Those that a sample was taken with (Sample::joints), else joints_at.
std::optional<machine::JointVector> joints_at(const Job& job, const Pose& X_MT, const Sample& sample);
/// The posture in which the machine begins a move, by name; empty of machines that have but one, or none with a name.
std::string posture_at_start(const Job& job, const gcode::Move& move);

/// What the orientation of a tool that turns in cuts adds to the distance of its tip from a programmed move: how the
/// middle of the ball, with its tip at `tip` and these A, B and C, is off the programmed middle that belongs to the
/// nearest point of the move, less how the tips are apart. m, in W; 0 for other jobs.
Vec3 middle_beside_tip(const Job& job, const gcode::Move& programmed, const Vec3& tip, const Vec3& axes);

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
/// Where moves that may cut have several orientations, the tool turns in them, or the stock is no whole block
/// (ToolFrame::turns), the stock stays what it is: what a ball takes does not depend on how it is turned as long as its
/// axis points upwards. Tools that are no ball stand upright in their cuts then.
///
/// Errors, with the line: MC206 a tool that is no ball turns in a move that may cut, or turns there without a way;
/// MC207 tools that are no balls may cut in several orientations, of which none is carried over to the other; MC213 a
/// ball that turns is tilted by more than kLargestTilt in W; MC208 a measured compliance, which holds for a tool along
/// z of M; MC209 a stock that is not a whole block, and a tool that is no ball; CT111 of its cells.
Status set_up(Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation);

/// Error: MC204 for the first feed move that may cut in another orientation than the job is set up for.
Status stands_as_set_up(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation);

/// Whether a move has the orientation for which the job is set up, at its start and at its end; where the tool turns in
/// cuts, whether its tool is a ball or stands upright.
bool stands_as_set_up(const Job& job, const gcode::Move& move);

/// The largest angle between the axis of a ball that turns in cuts and z of W.
inline constexpr double kLargestTilt = units::from_deg(70);

/// "A 20 B 0 deg", and C where the machine turns it or it is not 0.
std::string orientation_in_words(const Vec3& axes);

}  // namespace polypod::machining
