// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Any bytes as a machine file: they are refused with an error that has an id, or give a machine that is written and
// read back to the same text.
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string_view>

#include "polypod/machine/any_machine.hpp"

namespace {
void require(bool holds, const char* what) {
  if (holds) return;
  std::fprintf(stderr, "broken: %s\n", what);
  std::abort();
}
}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace polypod;
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto machine = machine::from_text(text, "fuzz.toml");
  if (!machine) {
    require(!machine.error().id.empty() && !machine.error().message.empty(), "an error has an id and a message");
    return 0;
  }
  const std::string written = machine::to_toml(*machine);
  const auto again = machine::from_text(written, "again.toml");
  if (!again) std::fprintf(stderr, "%s\n", to_string(again.error()).c_str());
  require(again.has_value(), "a written machine reads back");
  require(machine::to_toml(*again) == written, "a machine read back is written the same");
  return 0;
}
