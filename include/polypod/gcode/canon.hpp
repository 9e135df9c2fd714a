// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Canonical moves as text, line by line as LinuxCNC's `rs274 -g` prints them.
#pragma once

#include <string>

#include "polypod/core/error.hpp"
#include "polypod/gcode/program.hpp"

namespace polypod::gcode {

struct CanonOptions {
  /// A LinuxCNC tool table (`T1 P1 Z0.511 D0.125 ; remark`), lengths in inches, as rs274 takes them when it runs alone.
  /// Without one, the table of LinuxCNC's sample configuration, as rs274 does: T1 0.511, T2 0.1, T3 1.273, T99999 0.1.
  std::string tool_table;
  /// A LinuxCNC parameter file (`5221 10.0`): offsets of G54 ... G59.3 and G92, lengths in inches, and the active
  /// system (5220). Only read, never written. Without one, all offsets are 0 and G54 is active.
  std::string parameters;
  bool block_delete = false;    ///< whether blocks that begin with `/` are skipped
  bool files = true;            ///< whether subprograms may stand in files beside the program (`name.ngc`)
  long most_lines = 5'000'000;  ///< so many lines may run: more are taken for an endless loop (GC165)
};

/// The canonical calls of a program, one a line, in program units and in coordinates of the active offsets: what
/// `rs274 -t TABLE -v PARAMETERS -g PROGRAM` (LinuxCNC 2.9) writes to its standard output, byte for byte. M codes of
/// a machine's builder, which rs274 refuses where their files are not there, print nothing.
/// Errors: those of `interpret`; GC150 no M2, M30 or closing % (rs274 refuses that too), GC151 a tool that the table
/// does not hold, GC152 a malformed tool table or parameter file; FI100. Cost:
/// linear.
Result<std::string> canonical_text(const Program& program, const CanonOptions& options = {});
/// The same where the text may be long: it then lies in a temporary file.
Result<LongVector<char>> long_canonical_text(const Program& program, const CanonOptions& options = {});

}  // namespace polypod::gcode
