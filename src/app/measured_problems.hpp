// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the commands that read measured displacements say of them alike.
#pragma once

#include <fmt/format.h>

#include <string>
#include <vector>

#include "command.hpp"
#include "polypod/core/text.hpp"

namespace polypod::app {

inline Json problems_json(const std::vector<Error>& problems) {
  Json out = Json::array();
  for (const Error& e : problems) {
    out.push_back(
        {{"id", e.id}, {"message", e.message}, {"file", e.place.file}, {"line", e.place.line}, {"hint", e.hint}});
  }
  return out;
}

/// "doubtful: ID144 data.csv:5:1: ..." of each.
inline void print_doubts(const std::vector<Error>& doubts) {
  for (const Error& doubt : doubts) fmt::print("doubtful: {}\n", one_line(to_string(doubt)));
}

inline void print_unused(const std::vector<std::string>& columns) {
  if (columns.empty()) return;
  std::string names;
  for (const std::string& name : columns) names += (names.empty() ? "" : ", ") + one_line(name);
  fmt::print("note: columns that are not read: {}\n", names);
}

}  // namespace polypod::app
