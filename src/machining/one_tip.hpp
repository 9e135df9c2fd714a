// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The tool tip of the machine file, and programs with several tools.
#pragma once

#include <fmt/format.h>

#include <optional>
#include <set>
#include <string>
#include <vector>

#include "polypod/gcode/interpreter.hpp"

namespace polypod::machining {

/// What to say where several tools cut: all have the tool tip of the machine file.
template <class Moves>
std::optional<std::string> note_on_one_tip(const Moves& moves) {
  std::set<int> tools;
  for (const gcode::Move& move : moves) {
    if (move.kind != gcode::MoveKind::rapid && move.tool > 0) tools.insert(move.tool);
  }
  if (tools.size() < 2) return {};
  std::vector<std::string> names;
  for (const int tool : tools) names.push_back(fmt::format("T{}", tool));
  return fmt::format(
      "{} cut, and the tool tip of the machine file counts for all of them: with a tool of another length joints, "
      "reach "
      "and compliance at the same point are others",
      fmt::join(names, ", "));
}

}  // namespace polypod::machining
