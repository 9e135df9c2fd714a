// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A cell in motion, as a scene that plays.
#pragma once

#include <optional>

#include "polypod/pages/cell.hpp"
#include "polypod/report/scene.hpp"

namespace polypod::pages {

/// Bodies, belts, machines, items and containers over the pictures of a recorded run (cell::Picture), with counters.
/// Between the ends of a way machines are eased, not planned: when a tool is where is that of the simulation, how it
/// goes there is a picture. None where the run was not recorded.
std::optional<report::Scene> cell_film(const CellResult& result);

}  // namespace polypod::pages
