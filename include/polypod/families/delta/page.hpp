// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Page of a delta's workspace and its singular poses (KOZ Figures 4-18 to 4-34).
#pragma once

#include <string>

#include "polypod/families/delta/study.hpp"

namespace polypod::pages {

/// One self-contained HTML file: how the two methods agree, the boundary of the workspace in space with the machine and
/// with near-singular points in red, sections with the distance from singular poses, how many chains reach at four
/// heights, inputs. `study` is what delta_study() gave for the same options. The same input gives the same bytes.
/// `version` of Polypod and the command line that makes the page again, or empty. Errors: WS140, those of surface().
/// Cost: some seconds.
Result<std::string> delta_page(const machine::AnyMachine& machine, const workspace::DeltaStudy& study,
                               const workspace::DeltaStudyOptions& options, const std::string& version,
                               const std::string& command = {});

}  // namespace polypod::pages
