// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "machine_inputs.hpp"

#include <fmt/format.h>

#include "polypod/core/units.hpp"

namespace polypod::pages {

void add_machine_inputs(report::Report& report, const machine::AnyMachine& machine, const std::string& command) {
  using Entries = std::vector<std::pair<std::string, std::string>>;
  report.add_heading("Machine");
  if (const std::string about = machine::description_of(machine); !about.empty()) report.add_text(about);
  Entries settings;
  for (const machine::Parameter& p : machine::settings(machine)) {
    settings.emplace_back(p.key, fmt::format("{:.6g} {}", units::to_user(p.value, p.unit), p.unit));
  }
  report.add_definitions(settings);
  Entries sources;
  for (const auto& [key, source] : machine::provenance_of(machine)) sources.emplace_back(key, source);
  if (!sources.empty()) {
    report.add_heading("Where the numbers come from");
    report.add_definitions(sources);
  }
  report.add_code("The machine's file", machine::to_toml(machine));
  if (!command.empty()) report.add_code("The command that made this page", command, false);
}

}  // namespace polypod::pages
