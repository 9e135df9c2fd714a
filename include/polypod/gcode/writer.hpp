// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Changing a program: moves get new paths, everything else keeps its text.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/gcode/interpreter.hpp"
#include "polypod/gcode/program.hpp"

namespace polypod::gcode {

/// A point of a commanded path, and how to get there.
struct PathPoint {
  Vec3 p = Vec3::Zero();     ///< p_W, m
  Vec3 axes = Vec3::Zero();  ///< A, B, C, rad; written only where the move's block holds A, B or C
  std::optional<Vec3> centre =
      std::nullopt;  ///< p_W, m: an arc about it, in the plane and the sense of the replaced arc; else a line
};

/// A new path for one move: pieces from wherever the written program stands to each point in turn.
struct Replacement {
  int move = 0;                   ///< index into Interpretation::moves
  std::vector<PathPoint> points;  ///< at least one; the last one is the new end
};

struct RewriteOptions {
  InterpretOptions interpret;  ///< as given to `interpret`
  /// Decimals of written coordinates: at least these (0.1 um, 0.25 um, 0.2 urad), and as many as the program itself
  /// uses, so that a coordinate that is to stay is written as it was.
  int decimals_mm = 4;
  int decimals_inch = 5;
  int decimals_degree = 5;
};

struct Rewritten {
  Program program;         ///< parsed again from the text that was written
  LongVector<int> source;  ///< for each of its blocks, the block of the old program that it stands for
  int blocks_changed = 0;  ///< old blocks whose text is no longer the same
  int blocks_added = 0;
};

/// Writes `program` with new paths for some moves.
///
/// A replaced motion block becomes G1 blocks (G0 for a rapid; G2 or G3 for points with a centre), one a point; a point
/// that rounds onto the one before it needs none. The first block keeps N, F, S, T, G and M words and comments; X, Y, Z
/// are replaced, I, J, K, R and P are dropped. M0, M1, M2, M30 and M60, which act at the end of a move, go to the
/// last block. Each keeps the `/` and the line ending. Where the block was numbered, new blocks get numbers in between
/// if the gap to the next number permits, else none. Under G91 steps are written, each from the position that the
/// numbers before it add up to, so rounding never accumulates. Under G93 each block gets F so that the time of the
/// whole move stays.
///
/// Other blocks keep their text, except that
/// - a block that relied on a modal motion word which a rewritten block changed gets that word;
/// - a step under G91 is changed so that its axis comes to the programmed place, as it does under G90.
/// An axis without a word stays where it is: a pure Z retract stays one, at the corrected X and Y.
/// Coordinates are printed in full decimals, correctly rounded, without exponent and without a negative zero.
///
/// Errors: GC140 replacements that are unordered, empty, not finite or of no move; GC141 an arc that was not replaced
/// though the end of the move before it was moved, which would change its circle: replace it as well.
/// Cost: linear in blocks and points.
Result<Rewritten> rewrite(const Program& program, const Interpretation& interpretation,
                          std::span<const Replacement> replacements, const RewriteOptions& options = {});

/// The same; each replacement is asked for when its move comes, false says that there are no more.
Result<Rewritten> rewrite_each(const Program& program, const Interpretation& interpretation,
                               const std::function<bool(Replacement&)>& replacements,
                               const RewriteOptions& options = {});

/// The decimals that written coordinates have in a program (the larger of the options' and the program's own).
struct Decimals {
  int mm = 4;
  int inch = 5;
  int degree = 5;
};
Decimals decimals_of(const Program& program, const RewriteOptions& options = {});

/// A number in fixed notation, correctly rounded, without a negative zero. Range: finite, 0 <= decimals <= 15.
std::string format_number(double value, int decimals);

/// The same without zeros at the end.
std::string number(double value, int decimals);

/// The text of the block with the motion word `G<motion>` (0 to 3) before its first axis word if it has no motion word.
/// A block with a motion word, or without any axis word, is returned as it is.
std::string ensure_motion_word(const Block& block, int motion);

/// A text as it can stand in a comment of one line, whatever it holds: control characters become `\xNN`, `%` becomes
/// `_`, in comments between parentheses `(`, `)` and `;` become `[`, `]` and `,`, and what is longer than 240 bytes is
/// cut off. LinuxCNC refuses lines of more than 255 bytes, and some controllers take a `%` anywhere as the end of the
/// program and a `;` inside of parentheses as a comment.
std::string comment_text(const std::string& line, bool semicolon);

/// The program with comment lines after the leading `%` and O number, in the program's own comment style, and `code`
/// after them unless it is empty. Each line is one comment (comment_text).
Program with_header(const Program& program, std::span<const std::string> lines, const std::string& code = {});

/// The text of the block with `words` ("G64 P0.05 Q0") in the place of its path control word (G61, G61.1 or G64 with P
/// and Q). A block without one is returned as it is.
std::string with_path_control(const Block& block, const std::string& words);

}  // namespace polypod::gcode
