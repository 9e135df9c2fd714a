// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <memory>

#include "busy_line.hpp"
#include "commands.hpp"
#include "json_rows.hpp"
#include "messages.hpp"
#include "polypod/core/text.hpp"
#include "polypod/gcode/canon.hpp"
#include "polypod/gcode/explain.hpp"

namespace polypod::app {
namespace {

constexpr config::Range kLines{1, 2147483647.0};

std::string place_text(const std::array<double, 6>& at, bool inches) {
  std::string out;
  for (std::size_t k = 0; k < 6; ++k) {
    if (k < 3 || at[k] != 0)
      out += (out.empty() ? "" : " ") + std::string(1, "XYZABC"[k]) +
             unsigned_zero(fmt::format("{:.{}f}", at[k], inches ? 4 : 3));
  }
  return out;
}

Json meanings_json(const std::vector<gcode::Explanation::Meaning>& list) {
  Json out = Json::array();
  for (const auto& [word, meaning] : list) out.push_back({{"word", word}, {"meaning", meaning}});
  return out;
}

void print_meanings(const std::vector<gcode::Explanation::Meaning>& list) {
  std::size_t width = 0;
  for (const auto& one : list) width = std::max(width, std::min<std::size_t>(one.word.size(), 24));
  for (const auto& [word, meaning] : list) fmt::print("  {:{}}  {}\n", word, width, meaning);
}

/// Whether a canonical call moves the tool.
bool moves(const std::string& call) {
  return call.find("STRAIGHT_") != std::string::npos || call.find("ARC_FEED") != std::string::npos ||
         call.find("NURBS") != std::string::npos;
}

int print_explanation(const gcode::Explanation& e, bool json) {
  const bool moved = e.compensated ? e.from != e.to : std::any_of(e.calls.begin(), e.calls.end(), moves);
  if (json) {
    Json document{{"line", e.line}, {"text", one_line(e.text)}, {"runs", e.runs}};
    if (e.runs) {
      document["words"] = meanings_json(e.words);
      document["in_force"] = meanings_json(e.in_force);
      document["compensated"] = e.compensated;
      document["unit"] = e.inches ? "inch" : "mm";
      if (moved) {
        document["from"] = e.from;
        document["to"] = e.to;
      }
      document["canon"] = e.calls;
    }
    print_json(document);
    return kDone;
  }
  fmt::print("line {}: {}\n", e.line, one_line(e.text));
  if (!e.runs) {
    fmt::print("{}\n", e.divides
                           ? "the program does not stop here: it goes straight to the line behind where this branch "
                             "is the one to run"
                           : "the program never runs this line");
    return kDone;
  }
  print_meanings(e.words);
  if (moved) {
    fmt::print("the {} from {} to {} {}{}\n", e.compensated ? "programmed path goes" : "tool moves",
               place_text(e.from, e.inches), place_text(e.to, e.inches), e.inches ? "inch" : "mm",
               e.compensated ? "; the tool runs beside it, and where its move ends follows from the next one" : "");
  } else {
    const bool late = std::any_of(e.calls.begin(), e.calls.end(), moves);
    fmt::print("{}\n",
               late ? "the program commands no move here; the calls carry out the one before, which compensation delays"
                    : "the tool does not move");
  }
  if (!e.in_force.empty()) fmt::print("in force after it:\n");
  print_meanings(e.in_force);
  if (!e.calls.empty()) fmt::print("canonical calls:\n");
  for (const std::string& call : e.calls) fmt::print("  {}\n", call);
  return kDone;
}

}  // namespace

Command canon_command() {
  struct Options {
    std::string program;
    gcode::CanonOptions canon;
    int explain = 0;
  };
  auto o = std::make_shared<Options>();
  return {
      "canon", "Canonical moves of a program, one a line, as LinuxCNC's rs274 -g prints them",
      "polypod canon program.ngc",
      [o](Arguments& a) {
        a.positional("PROGRAM", o->program, "The G-code program");
        a.option("--tool-table", o->canon.tool_table, "A LinuxCNC tool table (lengths in inches, as rs274 reads it)");
        a.option("--parameters", o->canon.parameters, "A LinuxCNC parameter file with work offsets (only read)");
        a.flag("--block-delete", o->canon.block_delete, "Skip blocks that begin with /");
        a.option("--explain", o->explain, kLines,
                 "Say in words what this line does, counted from 1, where it runs first, and what is in force then");
      },
      [o](const Context& context) -> Result<int> {
        POLYPOD_TRY(check_files({o->program, o->canon.tool_table, o->canon.parameters}, {}));
        BusyLine busy(context, "reading and running the program");
        POLYPOD_ASSIGN(program, gcode::read(o->program));
        if (context.given("--explain")) {
          POLYPOD_ASSIGN(explanation, gcode::explain(program, o->explain, o->canon));
          busy.end();
          return print_explanation(explanation, context.json);
        }
        POLYPOD_ASSIGN(text, gcode::long_canonical_text(program, o->canon));
        busy.end();
        if (!context.json) {
          constexpr std::size_t kPart = 1 << 16;
          for (std::size_t at = 0; at < text.size(); at += kPart) {
            std::fwrite(text.run(at), 1, std::min(kPart, text.size() - at), stdout);
          }
          return kDone;
        }
        const auto lines = static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
        std::size_t at = 0;  // every line ends with a line break
        const auto next_line = [&](std::size_t) -> std::optional<Json> {
          std::string line;
          for (; text[at] != '\n'; ++at) line += text[at];
          ++at;
          return line;
        };
        print_json({{"canon", Json::array()}}, {{"canon", lines, next_line}});
        return kDone;
      }};
}

}  // namespace polypod::app
