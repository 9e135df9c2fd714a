// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The sections of pages that answer one question each, which the page of a machine joins. Each part gives back what it
// was asked with, for the one list of inputs at the end of a page.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "polypod/pages/quality.hpp"
#include "polypod/pages/workspace.hpp"
#include "polypod/report/html.hpp"

namespace polypod::pages {

struct ComplianceMap;

/// Names and values.
using Entries = std::vector<std::pair<std::string, std::string>>;

/// As workspace_page, or region_page of a task that does not hold x, y, z. Errors: theirs.
Result<Entries> add_workspace(report::Report& report, const machine::AnyMachine& machine,
                              const workspace::Options& options, const workspace::Volume& volume,
                              const WorkspacePageOptions& page);
Result<Entries> add_region(report::Report& report, const machine::AnyMachine& machine,
                           const workspace::Options& options, const workspace::Volume& region,
                           const WorkspacePageOptions& page);
/// The size of what they are about as a number and its unit.
std::pair<std::string, std::string> volume_figure(const workspace::Volume& volume);
std::pair<std::string, std::string> region_figure(const machine::Task& task, const workspace::Volume& region);
/// As quality_page. Errors: its.
Result<Entries> add_quality(report::Report& report, const machine::AnyMachine& machine,
                            const quality::SurveyOptions& options, const QualityQuestion& question,
                            const QualityFields& fields, const QualityPageOptions& page);
/// As compliance_map_page, without a map of each joint's share.
Entries add_compliance_map(report::Report& report, const ComplianceMap& map);

}  // namespace polypod::pages
