// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What one line of a program does, in words.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "polypod/gcode/canon.hpp"

namespace polypod::gcode {

/// One line as it runs for the first time.
struct Explanation {
  struct Meaning {
    std::string word;     ///< `X10`, with the value that an expression has
    std::string meaning;  ///< a phrase
  };
  int line = 0;
  std::string text;                    ///< as it is written
  bool runs = false;                   ///< false: the program never comes to the line; the rest is empty
  bool divides = false;                ///< an `else` or `elseif`, which is passed by where the branch behind it runs
  std::vector<Meaning> words;          ///< in the order of the line
  std::vector<Meaning> in_force;       ///< unit, plane, modes, offsets, tool, feed and spindle after the line;
                                       ///< empty where the program ends with it
  std::array<double, 6> from{}, to{};  ///< X, Y, Z in program units, A, B, C in deg, in the active coordinates
  bool compensated = false;        ///< cutter radius compensation is on: `from` and `to` are programmed places, and the
                                   ///< tool's call follows when the next move is known
  bool inches = false;             ///< the program unit after the line
  std::vector<std::string> calls;  ///< canonical calls of the line, as `canonical_text`
};

/// Runs the program up to the line and says what the line does. Lines are counted from 1. The start of the program is
/// that of rs274: the machine at its zero. Errors: GC153 the program has no such line; otherwise those of
/// `canonical_text` at a line that runs before it, or in the line itself. Cost: that of the program up to the line.
Result<Explanation> explain(const Program& program, int line, const CanonOptions& options = {});

}  // namespace polypod::gcode
