// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "machine_inputs.hpp"

#include <fmt/format.h>

#include "polypod/core/units.hpp"

namespace polypod::pages {

std::vector<std::pair<std::string, std::string>> figures_of(const machine::AnyMachine& machine) {
  std::vector<std::pair<std::string, std::string>> out;
  for (const machine::Parameter& p : machine::settings(machine)) {
    out.emplace_back(p.key, fmt::format("{:.6g} {}", units::to_user(p.value, p.unit), p.unit));
  }
  return out;
}

std::vector<std::pair<std::string, std::string>> sources_of(const machine::AnyMachine& machine) {
  std::vector<std::pair<std::string, std::string>> out;
  for (const auto& [key, source] : machine::provenance_of(machine)) out.emplace_back(key, source);
  return out;
}

void add_inputs(report::Report& report, const machine::AnyMachine& machine,
                const std::vector<std::pair<std::string, std::string>>& asked, const std::string& command) {
  report.add_section("Inputs");
  report.add_definitions(asked);
  report.add_heading("Machine");
  if (const std::string about = machine::description_of(machine); !about.empty()) report.add_text(about);
  report.add_definitions(figures_of(machine));
  if (const auto sources = sources_of(machine); !sources.empty()) {
    report.add_heading("Where the numbers come from");
    report.add_definitions(sources);
  }
  report.add_code("The machine's file", machine::to_toml(machine));
  if (!command.empty()) report.add_code("The command that made this page", command, false);
}

}  // namespace polypod::pages
