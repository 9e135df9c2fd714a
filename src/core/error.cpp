// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/core/error.hpp"

#include <fmt/format.h>

#include "polypod/core/text.hpp"

namespace polypod {

std::string to_string(const Error& error) {
  std::string text = error.id;
  if (!error.place.file.empty()) {
    text += ' ' + error.place.file;
    if (error.place.line > 0) text += fmt::format(":{}:{}", error.place.line, std::max(1, error.place.column));
  }
  text += ": " + error.message;
  if (!error.hint.empty()) text += "; " + error.hint;
  return one_line(text);  // values and names in it come from files and arguments
}

}  // namespace polypod
