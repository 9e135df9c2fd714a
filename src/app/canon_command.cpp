// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <memory>

#include "commands.hpp"
#include "polypod/gcode/canon.hpp"

namespace polypod::app {

Command canon_command() {
  struct Options {
    std::string program;
    gcode::CanonOptions canon;
  };
  auto o = std::make_shared<Options>();
  return {"canon", "Canonical moves of a program, one a line, as LinuxCNC's rs274 -g prints them",
          "polypod canon program.ngc",
          [o](Arguments& a) {
            a.positional("PROGRAM", o->program, "The G-code program");
            a.option("--tool-table", o->canon.tool_table,
                     "A LinuxCNC tool table (lengths in inches, as rs274 reads it)");
            a.option("--parameters", o->canon.parameters, "A LinuxCNC parameter file with work offsets (only read)");
            a.flag("--block-delete", o->canon.block_delete, "Skip blocks that begin with /");
          },
          [o](const Context& context) -> Result<int> {
            POLYPOD_TRY(check_files({o->program, o->canon.tool_table, o->canon.parameters}, {}));
            POLYPOD_ASSIGN(program, gcode::read(o->program));
            POLYPOD_ASSIGN(text, gcode::canonical_text(program, o->canon));
            if (!context.json) {
              fmt::print("{}", text);
              return kDone;
            }
            Json lines = Json::array();
            for (std::size_t at = 0; at < text.size();) {
              const std::size_t end = std::min(text.find('\n', at), text.size());
              lines.push_back(text.substr(at, end - at));
              at = end + 1;
            }
            print_json({{"canon", lines}});
            return kDone;
          }};
}

}  // namespace polypod::app
