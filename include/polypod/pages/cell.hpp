// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The documentation of a cell that was judged: page, drawing, record.
#pragma once

#include <string>

#include "polypod/cell/judge.hpp"
#include "polypod/cell/sequence.hpp"
#include "polypod/cell/sweep.hpp"

namespace polypod::pages {

using cell::CellResult;

/// A row an event: time_s, step, who, what, detail. Of the first seed; empty where the run was not recorded.
std::string cell_events_csv(const CellResult& result);

/// Views from the front, the top, the left, the right and isometric, with dimensions, as one SVG file.
std::string cell_drawing(const CellResult& result);

/// The same views as a DXF file (AutoCAD release 12, ASCII), 1 unit = 1 mm, in first-angle projection (ISO 5456-2):
/// outlines on a layer for each kind of body, machines at home, guards, belts, containers as circles seen from above,
/// and dimensions as lines and texts on the layer DIMENSIONS (no associative dimension entities).
std::string cell_dxf(const CellResult& result);

/// One self-contained HTML file: the documentation of the cell (KOZ 2.2): task, layout, machines, cycle, throughput,
/// cost, safety, parts, sequence. The same input gives the same bytes.
std::string cell_page(const CellResult& result, const std::string& version, const std::string& command = {});

/// One self-contained HTML file: the combinations of a sweep in a table, and their throughput as a picture.
std::string cell_sweep_page(const cell::Sweep& sweep, const std::string& version, const std::string& command = {});

}  // namespace polypod::pages
