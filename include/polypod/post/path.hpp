// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a part program asks of the tool, whatever language it was written in: an APT CL file or a G-code program.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/gcode/interpreter.hpp"
#include "polypod/geometry/pose.hpp"

namespace polypod::post {

enum class StepKind : std::uint8_t {
  rapid,          ///< the tool goes there without cutting
  line,           ///< a straight cut
  arc,            ///< a cut along a circle or a helix
  dwell,          ///< DELAY, G4
  stop,           ///< STOP, M0
  optional_stop,  ///< OPSTOP, M1
  comment         ///< PPRINT, REMARK, PARTNO
};

enum class Coolant : std::uint8_t { off, mist, flood };

/// One step of a part program, and what is in force during it. W is the workpiece frame.
struct Step {
  StepKind kind = StepKind::rapid;
  int line = 0;                 ///< of the source, from 1
  Vec3 tip = Vec3::Zero();      ///< p_W at the end, m
  Vec3 axis = Vec3::UnitZ();    ///< k_W at the end, unit, from the tip towards the spindle
  std::optional<Vec3> angles;   ///< A, B, C at the end where the source gives them (G-code), rad
  Vec3 centre = Vec3::Zero();   ///< arcs: a point on the axis of the circle, p_W, m
  Vec3 normal = Vec3::UnitZ();  ///< arcs: unit; the tip turns counterclockwise about it
  double sweep = 0;             ///< arcs: rad, > 0
  double feed = 0;              ///< m/s of the tip relative to the work; 0 for rapids and for turns without a way
  double spindle_speed = 0;     ///< rev/s
  gcode::Spindle spindle = gcode::Spindle::off;
  Coolant coolant = Coolant::off;
  int tool = 0;        ///< 0: none was loaded
  double seconds = 0;  ///< dwells
  std::string text;    ///< comments, one line

  [[nodiscard]] bool moves() const { return kind <= StepKind::arc; }
};

struct Path {
  std::string file;                ///< for messages
  std::vector<Step> steps;         ///< at least one of them moves
  std::vector<std::string> notes;  ///< what was assumed or left out
};

/// Reads an APT CL file (cutter location data, ISO 3592 words as CAM systems print them).
///
/// Understood: GOTO, FROM, GODLTA, GOHOME, RAPID, FEDRAT, SPINDL, LOADTL, TOOLNO, CIRCLE before a GOTO, MULTAX, TLAXIS,
/// CYCLE/DRILL, COOLNT, UNITS, STOP, OPSTOP, DELAY, PARTNO, PPRINT, REMARK, FINI, `$` and `$$`; words that move nothing
/// are noted. Whatever else is refused with its place: a word that changes motion is never skipped. FROM is the first
/// rapid. Without UNITS lengths are mm, with a note; a feed in inches is then refused (PO107). An axis whose length is
/// off 1 by at most 1 % is normalised.
/// Errors: PO101 to PO114. Cost: linear.
Result<Path> parse_cl(std::string_view text, const std::string& file);

/// The moves of a G-code program in W, the frame of G54. G4, M0, M1, M7, M8 and M9 are taken along, other words that
/// move nothing are counted in a note. Errors: those of gcode::understand, PO112.
Result<Path> read_program(const std::string& file, const gcode::InterpretOptions& options = {});

/// Whether a text is an APT CL file: its first statement is a word of APT (`GOTO/`, `PARTNO`, `$$`).
bool looks_like_cl(std::string_view text);

/// Either of the two, told by its text. Errors: FI100 and those of both.
Result<Path> read_path(const std::string& file);

}  // namespace polypod::post
