// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A stock as a surface in space.
#pragma once

#include <string>

#include "polypod/cutting/stock.hpp"
#include "polypod/report/scene.hpp"

namespace polypod::pages {

/// The heights of a stock over at most `cells` squares a side, with walls down to its bottom, at X_MW, mm. Walls lean
/// by one square; what an earlier set-up hollowed from below is not shown. Cost: one height a square.
report::Mesh stock_mesh(const cutting::Stock& stock, const Pose& X_MW, int cells, const std::string& name);

}  // namespace polypod::pages
