// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/gcode/unroll.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <string>

#include "engine.hpp"
#include "polypod/core/units.hpp"
#include "reader.hpp"
#include "text.hpp"

namespace polypod::gcode {
namespace {

/// G words that `interpret` does not take, times ten.
constexpr std::array kUnrolled{50,  51,  52,  53,  100, 280, 281, 300, 301, 382, 383, 384, 385, 410, 411, 420, 421, 520,
                               530, 591, 592, 593, 730, 740, 810, 820, 830, 840, 850, 860, 870, 880, 890, 920, 923};

}  // namespace

double dwell_of(const Block& block) {
  double wait = 0;
  bool dwells = false;
  for (const Word& word : block.words) {
    dwells = dwells || (word.letter == 'G' && word.value == 4);
    if (word.letter == 'P') wait = word.value;
  }
  return dwells ? wait : 0;
}

double dwell_time(const Program& program, bool block_delete) {
  double out = 0;
  for (const Block& block : program.blocks) {
    if (block.after_end) break;
    if (!(block_delete && block.optional)) out += dwell_of(block);
  }
  return out;
}

/// Whether a comment ends the program: (ABORT, ...).
bool aborts(const Block& block) {
  if (block.text.find('(') == std::string_view::npos) return false;
  const std::vector<std::string_view> all = comments(block);
  return std::any_of(all.begin(), all.end(), [](std::string_view c) {
    return c.size() > 2 && begins_with(from_first_word(c.substr(1)), "ABORT,");
  });
}

bool needs_unrolling(const Program& program) {
  for (const Block& block : program.blocks) {
    if (block.after_end) break;
    if (block.construct != Construct::none || aborts(block)) return true;
    bool dwell = false;
    bool axes = false;
    for (const Word& word : block.words) {
      dwell = dwell || (word.letter == 'G' && word.value == 4);
      axes = axes || (word.letter >= 'X' && word.letter <= 'Z') || (word.letter >= 'A' && word.letter <= 'C');
      if (dwell && axes) return true;
      if (word.letter == 'M' && (word.value == 98 || word.value == 99)) return true;
      if (word.letter == 'M' && word.value >= 70 && word.value <= 73) return true;
      if (word.letter == '@' || word.letter == '^') return true;
      if (word.letter != 'G' || word.value < 5 || word.value > 93) continue;
      const long code = std::lround(word.value * 10);
      if (std::find(kUnrolled.begin(), kUnrolled.end(), code) != kUnrolled.end()) return true;
    }
  }
  return false;
}

Result<Unrolled> unroll(Program program, const UnrollOptions& options) {
  Unrolled out;
  if (!needs_unrolling(program)) {
    out.program = std::move(program);
    return out;
  }
  EngineOptions engine;
  engine.any_tool = true;
  engine.machine_known = false;
  engine.diameters = options.diameters;
  engine.diameter = options.diameter;
  engine.block_delete = options.interpret.block_delete;
  engine.m_codes = options.interpret.m_codes;
  engine.files = options.files;
  engine.most_lines = options.most_lines;
  engine.text = false;
  engine.plain = true;
  engine.checks = true;
  for (std::size_t i = 0; i < options.interpret.work_offsets.size(); ++i) {
    for (int k = 0; k < 3; ++k) {
      engine.parameters[5221 + 20 * static_cast<int>(i) + k] = units::to_inch(options.interpret.work_offsets[i][k]);
    }
  }
  Engine run(program, engine);
  POLYPOD_TRY(run.run());
  const Program plain = run.take_plain();
  LineReader reader(program.path);
  std::string text;
  for (std::size_t i = 0; i < plain.blocks.size(); ++i) {
    const Block& block = plain.blocks[i];
    text = block.text;
    if (options.source_lines && !block.text.empty() && !block.percent && block.text != "%") {
      std::string file = std::filesystem::path(run.file_of(i)).filename().string();
      for (char& c : file) {
        if (std::string_view("%();").find(c) != std::string_view::npos) c = '_';
      }
      const bool remark = block.text.find(';') != std::string::npos;
      const bool full = block.text.size() + file.size() > 220;
      if (!remark && !full) {
        const std::string from = fmt::format("({}line {})", file.empty() ? "" : file + " ", block.line);
        // LinuxCNC acts on the last comment of a line alone: a message stays the last.
        const std::size_t message = text.find('(');
        if (message == std::string::npos) {
          text += " " + from;
        } else {
          text.insert(message, from + " ");
        }
      }
    }
    text += block.ending;
    POLYPOD_TRY(reader.add(text, block.line));
  }
  out.program = reader.take();
  out.unrolled = true;
  out.notes = run.take_notes();
  out.notes.emplace_back(
      "parameters, subprograms, loops, cycles and shifts of the coordinates are carried out: the program counts as the "
      "plain blocks that it comes to, each with the line that it stands on");
  if (std::any_of(program.blocks.begin(), program.blocks.end(), [](const Block& b) { return b.optional; })) {
    out.notes.push_back(fmt::format("{} are {}, and the other position of the switch is not judged", kBlockDeleteNote,
                                    options.interpret.block_delete ? "left out" : "carried out like all others"));
  }
  return out;
}

void drop_block_delete_note(std::vector<std::string>& notes) {
  std::erase_if(notes, [](const std::string& note) { return note.starts_with(kBlockDeleteNote); });
}

Result<Understood> understand(const std::string& path, const UnrollOptions& options) {
  POLYPOD_ASSIGN(source, read(path));
  return understand(std::move(source), options);
}

Result<Understood> understand(Program source, const UnrollOptions& options) {
  POLYPOD_ASSIGN(unrolled, unroll(std::move(source), options));
  POLYPOD_ASSIGN(run, interpret(unrolled.program, options.interpret));
  run.notes.insert(run.notes.begin(), unrolled.notes.begin(), unrolled.notes.end());
  return Understood{std::move(unrolled.program), std::move(run), unrolled.unrolled};
}

}  // namespace polypod::gcode
