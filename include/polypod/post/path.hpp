// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a part program asks of the tool, whatever language it was written in: an APT CL file or a G-code program.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/gcode/header.hpp"
#include "polypod/gcode/interpreter.hpp"
#include "polypod/gcode/unroll.hpp"
#include "polypod/geometry/pose.hpp"

namespace polypod::post {

enum class StepKind : std::uint8_t {
  rapid,          ///< the tool goes there without cutting
  line,           ///< a straight cut
  arc,            ///< a cut along a circle or a helix
  dwell,          ///< DELAY, G4
  stop,           ///< STOP, M0
  optional_stop,  ///< OPSTOP, M1
  comment,        ///< PPRINT, REMARK, PARTNO, comments of a program
  words           ///< programs: words that move nothing, which take effect here (T, S, M3, M8, G43, G61, ...)
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
  /// Comments, one line; of `words` what G-code writes, in mm; of stops the word ("M0", "M60").
  std::string text;
  std::string meaning;  ///< of `words`, for languages that have no such word; empty where there is nothing to switch
  bool robots = true;   ///< of `words`: false where a robot's program cannot do without them (M62 to M68, M100 to M199)
  bool path_mode = false;  ///< of `words`: G61, G61.1 or G64
  /// Which of X, Y, Z the program has said by the end of this move; rapids alone may have unknown ones, 0 in `tip`.
  std::array<bool, 3> known{true, true, true};
  bool start_known = true;     ///< of moves: whether all three were known before it
  bool length_offset = false;  ///< of `words`: G43, G43.1, G49; coordinates must be written anew behind them
  bool turned = true;          ///< whether A, B or C have been commanded up to here (CL files: always)
  std::optional<gcode::PathControl> path;  ///< in force, where the program says one

  [[nodiscard]] bool moves() const { return kind <= StepKind::arc; }
  /// Whether it moves to a place that is known whole.
  [[nodiscard]] bool placed() const { return moves() && known[0] && known[1] && known[2]; }
};

/// A move of the source that is not in the path.
struct LeftOut {
  int line = 0;
  std::string text;
};

struct Path {
  std::string file;                ///< for messages
  std::vector<Step> steps;         ///< at least one of them moves
  std::vector<std::string> notes;  ///< what was assumed or left out
  bool program = false;            ///< G-code: `words` steps say what is switched, not the state of each step
  std::string end = "M2";          ///< the word that ends it
  std::vector<LeftOut> left_out;   ///< moves in machine coordinates behind the last other move (G53, G28, G30)
  int c_line = 0;                  ///< of a G-code program the first line that commands C; 0: none does

  /// Whether it is a G-code program that says nothing of C: what is chosen or given for C then counts.
  [[nodiscard]] bool leaves_c() const { return program && c_line == 0; }
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

struct ProgramOptions {
  gcode::UnrollOptions unroll;  ///< work offsets, block delete, cutters for G41 and G42
  /// Whether somebody has said if blocks that begin with `/` are carried out; else a program with them is refused.
  bool block_delete_said = false;
  /// A last word on the program before it is taken, e.g. on work offsets that nobody has given.
  std::function<Status(const gcode::Understood&)> accept;
};

/// A G-code program in W, the frame of G54, with what it switches in the order of RS-274 within a block: S and T, M6 or
/// M61, M3 to M5, M7 to M9, M48 to M53, M62 to M68, M100 to M199, G4, G43 to G49, G61 to G64, the move, M0, M1 or M60.
/// Comments are taken along. The feed is that of each move, whether F or G93 gave it.
/// Errors: those of gcode::understand and `accept`; PO112; PO116 a move in machine coordinates (G53, G28, G30) with
/// other moves behind it, or a cut in them; PO117 a cut whose start is not known, or rotary axes that turn where the
/// place is not known; PO118 a word that is not carried over; PO126 `/` without block_delete_said. Cost: linear.
Result<Path> read_program(const std::string& file, const ProgramOptions& options = {});

/// What `correct` wrote over the program; that of the first header, for programs that were corrected again have
/// several.
std::optional<gcode::CorrectionHeader> correction_header(const Path& path);

/// Whether a text is an APT CL file: its first statement is a word of APT (`GOTO/`, `PARTNO`, `$$`).
bool looks_like_cl(std::string_view text);

/// Either of the two, told by its text. Errors: FI100 and those of both.
Result<Path> read_path(const std::string& file, const ProgramOptions& options = {});

}  // namespace polypod::post
