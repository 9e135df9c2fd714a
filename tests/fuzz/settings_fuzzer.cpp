// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Any bytes as `--set` of the catalogue's machines: the first byte chooses the machine, each line is `key=value`. They
// are refused with an error, or give a machine whose parameters are finite and can be set again.
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/machine/any_machine.hpp"
#include "require.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace polypod;
  using fuzz::require;
  if (size == 0) return 0;
  const auto entries = machine::catalogue();
  const auto& entry = entries[data[0] % entries.size()];
  std::vector<machine::Override> overrides;
  std::string_view text(reinterpret_cast<const char*>(data) + 1, size - 1);
  while (!text.empty() && overrides.size() < 16) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    const std::string_view line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    const std::size_t equals = line.find('=');
    if (equals == std::string_view::npos) continue;
    overrides.push_back({std::string(line.substr(0, equals)), std::string(line.substr(equals + 1))});
  }
  const auto machine = machine::load(std::string(entry.name), overrides);
  if (!machine) return fuzz::require_error(machine.error()), 0;
  for (const machine::Parameter& p : machine::settings(*machine))
    require(std::isfinite(p.value), "parameters are finite");
  const std::string written = machine::to_toml(*machine);
  const auto again = machine::from_text(written, "again.toml");
  if (!again) std::fprintf(stderr, "%s\n", to_string(again.error()).c_str());
  require(again.has_value(), "a machine that was set is written and read back");
  return 0;
}
