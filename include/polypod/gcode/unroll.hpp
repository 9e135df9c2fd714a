// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A program with parameters, subprograms, loops, cycles and shifted coordinates, as plain blocks.
#pragma once

#include <array>
#include <map>
#include <string>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/gcode/interpreter.hpp"
#include "polypod/gcode/program.hpp"

namespace polypod::gcode {

/// How the note begins that says what became of such blocks.
inline constexpr const char* kBlockDeleteNote = "blocks that begin with /";

/// Takes that note away, where both positions were judged.
void drop_block_delete_note(std::vector<std::string>& notes);

/// Whether a program holds what `interpret` does not take itself: expressions, parameters, O words, M70 to M73, M98 and
/// M99, polar coordinates, canned cycles, G4 beside axis words, G5 to G5.3, G10, G28, G30, G38.2 to G38.5, G41 and G42,
/// G52, G53, G59.1 to G59.3, G92. Cost: linear.
bool needs_unrolling(const Program& program);

struct UnrollOptions {
  InterpretOptions interpret;   ///< as given to `interpret`: work offsets, block delete
  bool files = true;            ///< whether subprograms may stand in files beside the program (`name.ngc`)
  long most_lines = 5'000'000;  ///< so many lines may run: more are taken for an endless loop (GC165)
  /// Diameters of cutters by tool number, m: what G41 and G42 compensate. G41.1 and G42.1 bring theirs.
  std::map<int, double> diameters;
  /// That of the tool in the spindle where `diameters` does not hold it, m; 0: not known, and G41 without D is refused.
  double diameter = 0;
  bool source_lines = false;  ///< whether each block that is not as it was ends with a comment `(line 12)`
};

struct Unrolled {
  Program program;        ///< plain blocks; Block::line is the line of the source
  bool unrolled = false;  ///< false where the program is given back as it is
  std::vector<std::string> notes;
};

/// Runs the program and writes what it does as plain blocks, which `interpret` takes. A program that needs no unrolling
/// is given back as it is.
///
/// Coordinates are those of G54 to G59 as the job has them: G52, G92 and G10 L20 are carried out, not written. The
/// machine's zero is not known: G10 L2, G59.1 and reading positions that the program has not commanded are refused;
/// G53, G28 and G30 pass through, and the axes that they move are not known after them. Coordinates are written with 6
/// decimals in mm and 7 in inches, steps under G91 with 9.
/// Errors: those of `interpret`, and GC160 to GC169. Cost: linear in the lines that run.
Result<Unrolled> unroll(Program program, const UnrollOptions& options = {});

/// How long the dwells (G4 P) of a program of plain blocks take together, s. With `block_delete`, blocks that begin
/// with
/// `/` do not count.
double dwell_time(const Program& program, bool block_delete);
/// The same of one block, 0 where it is none.
double dwell_of(const Block& block);

/// A program as the commands take it: read, unrolled where that is needed, and run.
struct Understood {
  Program program;  ///< plain blocks
  Interpretation interpretation;
  bool unrolled = false;
};

/// Errors: those of `read`, `unroll` and `interpret`.
Result<Understood> understand(const std::string& path, const UnrollOptions& options);
/// The same of a program that was read.
Result<Understood> understand(Program source, const UnrollOptions& options);

}  // namespace polypod::gcode
