// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Shapes in the plane for pictures.
#pragma once

#include <vector>

#include "polypod/cutting/stock.hpp"
#include "polypod/report/plot.hpp"

namespace polypod::pages {

/// The border of a stock seen from above, mm: closed lines, material to their left. The stock is looked at in squares
/// of at most 400 a side; a border runs where half a square holds material, between squares linearly. Cost: linear in
/// the cells.
std::vector<std::vector<report::Point>> stock_outline(const cutting::Stock& stock);

/// A line cut to the rectangle lo..hi: the pieces inside it, in order.
std::vector<std::vector<report::Point>> clip(const std::vector<report::Point>& line, const report::Point& lo,
                                             const report::Point& hi);

/// The points within `radius` of a smooth line of at least two points, as a closed outline with round ends.
std::vector<report::Point> tube(const std::vector<report::Point>& line, double radius);

}  // namespace polypod::pages
