// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/gcode/calls.hpp"

#include <algorithm>
#include <filesystem>
#include <set>
#include <string_view>

#include "expression.hpp"
#include "polypod/core/file_parts.hpp"
#include "words.hpp"

namespace polypod::gcode {
namespace {

/// The label that a line calls; empty where it calls none.
std::string called_label(std::string_view line) {
  if (auto word = o_word_of(line)) return word->second == "call" ? std::move(word->first) : std::string();
  std::string plain;  // without blanks and comments
  for (const char c : line.substr(0, line.find(';'))) {
    if (c == '(') break;
    if (!is_space(c) && c != '\n') plain += upper(c);
  }
  if (plain.find("M98") == std::string::npos) return {};
  std::size_t at = plain.find('P');
  if (at == std::string::npos) return {};
  std::string label;
  for (++at; at < plain.size() && plain[at] >= '0' && plain[at] <= '9'; ++at) {
    if (!label.empty() || plain[at] != '0') label += plain[at];
  }
  return label;
}

}  // namespace

std::vector<std::string> files_called(const std::string& program) {
  const std::filesystem::path folder = std::filesystem::path(program).parent_path();
  std::vector<std::string> found;
  std::set<std::string> labels;
  const auto look_into = [&](const std::string& file) {
    std::string line;
    const auto end_line = [&] {
      const std::string label = called_label(line);
      line.clear();
      if (label.empty() || label.find_first_of("/\\:") != std::string::npos || !labels.insert(label).second) return;
      const std::filesystem::path path = folder / (label + ".ngc");
      std::error_code none;
      if (std::filesystem::is_regular_file(path, none)) found.push_back(path.string());
    };
    const Status read = files::read_parts(file, [&](std::string_view part) -> Status {
      for (const char c : part) {
        if (c == '\n') {
          end_line();
        } else {
          line += c;
        }
      }
      return {};
    });
    if (read) end_line();
  };
  look_into(program);
  for (std::size_t i = 0; i < found.size(); ++i) look_into(std::string(found[i]));
  return found;
}

}  // namespace polypod::gcode
