// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a page about a machine ends with.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "polypod/machine/any_machine.hpp"
#include "polypod/report/html.hpp"

namespace polypod::pages {

/// A machine's figures with their units, and where they come from.
std::vector<std::pair<std::string, std::string>> figures_of(const machine::AnyMachine& machine);
std::vector<std::pair<std::string, std::string>> sources_of(const machine::AnyMachine& machine);

/// A section of what was asked, the machine's description, figures, sources and file, and the command that made the
/// page where it is given.
void add_inputs(report::Report& report, const machine::AnyMachine& machine,
                const std::vector<std::pair<std::string, std::string>>& asked, const std::string& command);

}  // namespace polypod::pages
