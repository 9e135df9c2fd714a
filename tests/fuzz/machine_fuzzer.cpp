// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Any bytes as a machine file: they are refused with an error that has an id, or give a machine that is written and
// read back to the same text.
#include <cstdint>
#include <cstdio>
#include <string_view>

#include "polypod/machine/any_machine.hpp"
#include "require.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace polypod;
  using fuzz::require;
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto machine = machine::from_text(text, "fuzz.toml");
  if (!machine) {
    fuzz::require_error(machine.error());
    return 0;
  }
  const std::string written = machine::to_toml(*machine);
  const auto again = machine::from_text(written, "again.toml");
  if (!again) std::fprintf(stderr, "%s\n", to_string(again.error()).c_str());
  require(again.has_value(), "a written machine reads back");
  require(machine::to_toml(*again) == written, "a machine read back is written the same");
  return 0;
}
