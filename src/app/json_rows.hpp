// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// JSON documents with lists that may be long: they are printed element by element.
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <vector>

#include "command.hpp"

namespace polypod::app {

struct JsonRows {
  const char* key;  ///< of the document, which holds an empty list there
  std::size_t count = 0;
  std::function<std::optional<Json>(std::size_t)> row;  ///< nothing: it is left out
};

/// The document with its numbers to fifteen significant digits: the sixteenth and seventeenth are the rounding of units
/// (1.15 m are 1150.0000000000002 mm).
std::string json_text(Json document);

/// What print_json would print if the lists of the document held their rows.
void print_json(const Json& document, const std::vector<JsonRows>& lists);

}  // namespace polypod::app
