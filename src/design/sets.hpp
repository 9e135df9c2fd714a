// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Numbers that a study fixes or varies, as overrides of a machine or a cell.
#pragma once

#include <fmt/format.h>

#include <string>
#include <vector>

#include "polypod/core/config.hpp"

namespace polypod::design {

/// All the digits that make the same number again.
inline std::string number(double value) {
  return fmt::format("{}", value);
}

/// What the study fixes before it begins: `key` and `value` of each table [[set]]. Errors: those of the tables.
template <class Override>
Result<std::vector<Override>> overrides_of(const std::vector<config::Table>& sets) {
  std::vector<Override> out;
  for (const config::Table& t : sets) {
    POLYPOD_ASSIGN(key, t.text("key"));
    POLYPOD_ASSIGN(value, t.number("value"));
    POLYPOD_TRY(t.finish());
    out.push_back({key, number(value)});
  }
  return out;
}

}  // namespace polypod::design
