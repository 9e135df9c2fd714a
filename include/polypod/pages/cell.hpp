// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The documentation of a cell that was judged: page, drawing, record.
#pragma once

#include <string>

#include "polypod/cell/judge.hpp"
#include "polypod/cell/sequence.hpp"

namespace polypod::pages {

using cell::CellResult;

/// A row an event: time_s, step, who, what, detail. Of the first seed; empty where the run was not recorded.
std::string cell_events_csv(const CellResult& result);

/// Views from the front, the top, the left, the right and isometric, with dimensions, as one SVG file.
std::string cell_drawing(const CellResult& result);

/// One self-contained HTML file: the documentation of the cell (KOZ 2.2): task, layout, machines, cycle, throughput,
/// cost, safety, parts, sequence. The same input gives the same bytes.
std::string cell_page(const CellResult& result, const std::string& version, const std::string& command = {});

}  // namespace polypod::pages
