// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Any bytes as a tool table and as a parameter file of LinuxCNC: refused with an error and its place, or canonical
// moves that are numbers.
#include <cstdint>
#include <string>
#include <string_view>

#include "memory_file.hpp"
#include "polypod/gcode/canon.hpp"
#include "require.hpp"

namespace {

using namespace polypod;
using fuzz::require;

void check(const gcode::Program& program, const gcode::CanonOptions& options) {
  const auto text = gcode::canonical_text(program, options);
  if (!text) {
    fuzz::require_error(text.error());
    require(!text.error().hint.empty(), "an error about a table has a hint");
    return;
  }
  require(text->find("nan") == std::string::npos && text->find("inf") == std::string::npos, "moves are numbers");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const gcode::Program program = *gcode::parse(
      "G21 G90 G55\nT1 M6\nG43 H1\nG0 X1 Y2 Z3\nG92 X0\nG1 X5 F100\nG54 T2 M6\nG43\nG1 Z-1\nG49\nM2\n", "fixed.ngc");
  const fuzz::MemoryFile file({reinterpret_cast<const char*>(data), size});
  gcode::CanonOptions tools, parameters, both;
  tools.tool_table = both.tool_table = file.path();
  parameters.parameters = both.parameters = file.path();
  for (const gcode::CanonOptions& options : {tools, parameters, both}) check(program, options);
  return 0;
}
