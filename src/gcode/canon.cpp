// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A second, independent run through the program, in its own units: `interpret` has checked plain programs, this prints
// them; programs with parameters, subprograms and cycles are checked as they run.
#include "polypod/gcode/canon.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <map>
#include <memory>
#include <string_view>
#include <utility>
#include <vector>

#include "engine.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"
#include "polypod/gcode/interpreter.hpp"
#include "polypod/gcode/unroll.hpp"

namespace polypod::gcode {
namespace {

char upper(char c) {
  return c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
}
bool is_space(char c) {
  return c == ' ' || c == '\t' || c == '\r';
}

/// The table that rs274 falls back to (LinuxCNC's sample configuration).
std::vector<Tool> sample_tools() {
  const auto tool = [](int number, double length, double diameter) {
    Tool t;
    t.number = number;
    t.pocket = number == 99999 ? 123 : number;
    t.offset[2] = length;
    t.diameter = diameter;
    return t;
  };
  return {tool(1, 0.511, 0.125), tool(2, 0.1, 0.0625), tool(3, 1.273, 0.201), tool(99999, 0.1, 0)};
}

/// Calls `line(number, text, first column)` for every line that holds more than blanks, without its remark.
template <class F>
Status each_line(std::string_view text, std::string_view remarks, F&& line) {
  int number = 0;
  while (!text.empty()) {
    const std::size_t newline = text.find('\n');
    std::string_view part = text.substr(0, newline);
    text = newline == std::string_view::npos ? std::string_view{} : text.substr(newline + 1);
    ++number;
    part = part.substr(0, part.find_first_of(remarks));
    while (!part.empty() && is_space(part.back())) part.remove_suffix(1);
    if (!part.empty()) POLYPOD_TRY(line(number, part));
  }
  return {};
}

/// The words of a line between blanks, with their columns (from 1).
std::vector<std::pair<std::string_view, int>> split(std::string_view line) {
  std::vector<std::pair<std::string_view, int>> words;
  for (std::size_t i = 0; i < line.size();) {
    if (is_space(line[i])) {
      ++i;
      continue;
    }
    std::size_t end = i;
    while (end < line.size() && !is_space(line[end])) ++end;
    words.emplace_back(line.substr(i, end - i), static_cast<int>(i) + 1);
    i = end;
  }
  return words;
}

/// The whole of `text` as a finite number.
bool to_number(std::string_view text, double& value) {
  if (text.starts_with('+')) text.remove_prefix(1);
  const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), value);
  return code == std::errc() && end == text.data() + text.size() && std::isfinite(value);
}

Result<std::vector<Tool>> read_tools(const std::string& path) {
  if (path.empty()) return sample_tools();
  POLYPOD_ASSIGN(text, files::read(path));
  std::vector<Tool> tools;
  POLYPOD_TRY(each_line(text, ";", [&](int number, std::string_view line) -> Status {
    Tool tool;
    bool has_number = false;
    bool has_pocket = false;
    for (const auto& part : split(line)) {
      const std::string_view word = part.first;
      const auto bad = [&](std::string_view why) {
        const Place place{path, number, part.second};
        return fail("GC152", fmt::format("{} {}", word, why), place, "a tool is a line like T1 P1 Z0.511 D0.125");
      };
      double value = 0;
      if (!to_number(word.substr(1), value)) return bad("is no word of a tool table");
      const char letter = upper(word.front());
      if (letter == 'T' || letter == 'P') {
        if (value < 0 || value > 99999 || value != std::floor(value)) return bad("is no number from 0 to 99999");
        (letter == 'T' ? has_number : has_pocket) = true;
        (letter == 'T' ? tool.number : tool.pocket) = static_cast<int>(value);
      } else if (const std::size_t axis = std::string_view("XYZABCUVW").find(letter); axis != std::string_view::npos) {
        tool.offset[axis] = value;
      } else if (letter == 'D') {
        tool.diameter = value;
      } else if (letter == 'I') {
        tool.front_angle = value;
      } else if (letter == 'J') {
        tool.back_angle = value;
      } else if (letter == 'Q') {
        tool.orientation = static_cast<int>(std::clamp(value, -1e6, 1e6));
      } else {
        return bad("is no word of a tool table");
      }
    }
    if (!has_number || !has_pocket) {
      return fail("GC152", "a tool without T or P", Place{path, number, 1},
                  "a tool is a line like T1 P1 Z0.511 D0.125");
    }
    tools.push_back(tool);
    return {};
  }));
  return tools;
}

Result<std::map<int, double>> read_parameters(const std::string& path) {
  constexpr int kFirst = 1, kLast = 5602;  // of LinuxCNC 2.9
  std::map<int, double> parameters;
  if (path.empty()) return parameters;
  int before = 0;
  POLYPOD_ASSIGN(text, files::read(path));
  POLYPOD_TRY(each_line(text, ";#", [&](int number, std::string_view line) -> Status {
    const auto words = split(line);
    double index = 0;
    double value = 0;
    if (words.size() != 2 || !to_number(words[0].first, index) || !to_number(words[1].first, value) ||
        index != std::floor(index)) {
      return fail("GC152", fmt::format("'{}' is no parameter", line), Place{path, number, 1},
                  "a parameter is a line like 5221 10.0");
    }
    const int i = index >= kFirst && index < kLast ? static_cast<int>(index) : 0;
    if (i == 0) {
      return fail("GC152", fmt::format("{} is no number of a parameter", words[0].first),
                  Place{path, number, words[0].second}, fmt::format("parameters are {} to {}", kFirst, kLast - 1));
    }
    if (i <= before) {
      return fail("GC152",
                  fmt::format("parameter {} follows {}: LinuxCNC refuses a file that does not ascend", i, before),
                  Place{path, number, words[0].second}, "sort the lines by their numbers, each number once");
    }
    before = i;
    if (i == 5220 && (value < 1 || value > 9 || value != std::floor(value))) {
      return fail("GC152", fmt::format("{} is no coordinate system; 5220 is an integer from 1 to 9", value),
                  Place{path, number, words[1].second}, "1 is G54, 6 is G59");
    }
    parameters[i] = value;
    return {};
  }));
  return parameters;
}

}  // namespace

Result<EngineOptions> engine_options(const Program& program, const CanonOptions& options, int until) {
  EngineOptions engine;
  POLYPOD_ASSIGN(tools, read_tools(options.tool_table));
  POLYPOD_ASSIGN(parameters, read_parameters(options.parameters));
  engine.tools = std::move(tools);
  engine.block_delete = options.block_delete;
  engine.files = options.files;
  engine.most_lines = options.most_lines;
  const bool turned = std::any_of(parameters.begin(), parameters.end(), [](const auto& p) {
    return p.first >= 5230 && p.first <= 5390 && p.first % 20 == 10 && p.second != 0;
  });
  engine.checks = turned || needs_unrolling(program) || parameters.contains(5220);
  InterpretOptions checks;
  checks.block_delete = options.block_delete;
  for (std::size_t i = 0; i < checks.work_offsets.size(); ++i) {
    for (int k = 0; k < 3; ++k) {
      const auto at = [&](int index) {
        const auto found = parameters.find(index);
        return found != parameters.end() ? found->second : 0.0;
      };
      checks.work_offsets[i][k] =
          units::from_inch(at(5221 + 20 * static_cast<int>(i) + k) + (at(5210) != 0 ? at(5211 + k) : 0));
    }
  }
  engine.parameters = std::move(parameters);
  if (engine.checks) return engine;
  const Status judged = judge(program, checks);
  const bool behind = !judged && until > 0 && judged.error().place.line > until;
  if (!behind) POLYPOD_TRY(judged);
  return engine;
}

namespace {

/// A run through the whole program. Errors: those of canonical_text.
Result<std::unique_ptr<Engine>> run_of(const Program& program, const CanonOptions& options) {
  POLYPOD_ASSIGN(engine, engine_options(program, options));
  auto run = std::make_unique<Engine>(program, std::move(engine));
  POLYPOD_TRY(run->run());
  if (!run->ended()) {
    return fail("GC150", "no M2, M30 or closing %: LinuxCNC refuses a program without an end",
                Place{program.path, program.blocks.empty() ? 0 : program.blocks.back().line, 1}, "end it with M2");
  }
  return run;
}

}  // namespace

Result<std::string> canonical_text(const Program& program, const CanonOptions& options) {
  POLYPOD_ASSIGN(run, run_of(program, options));
  return run->take_text();
}

Result<LongVector<char>> long_canonical_text(const Program& program, const CanonOptions& options) {
  POLYPOD_ASSIGN(run, run_of(program, options));
  return run->take_long_text();
}

}  // namespace polypod::gcode
