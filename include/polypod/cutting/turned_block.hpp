// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A block of material seen along a tool that does not stand square to it.
#pragma once

#include "polypod/cutting/stock.hpp"

namespace polypod::cutting {

/// The block from `min` to `max` (m, in W) as a height map in the frame S of the same origin; `R_SW` turns W into S,
/// whose z axis is the tool axis.
///
/// A convex body meets every line along z of S in one interval: above (x, y) it reaches from the highest of its lower
/// faces to the lowest of its upper ones. The first is the stock's `hollow`, where it lies above the lowest corner, the
/// second its height; both are taken at the middle of that part of a cell that the outline of the block holds (exact
/// for plane faces), and a cell that the outline crosses keeps that share of its layers (Stock::keep_share). So the
/// volume is right but for cells on an edge between two upper or two lower faces (of second order in the cell) and the
/// eighths of cells on the outline.
///
/// Errors: CT110, CT111 as of Stock::block. Cost: 12 plane equations a cell.
Result<Stock> turned_block(const Vec3& min, const Vec3& max, const Mat3& R_SW, double cell);

/// Whether a stock is a whole block: every layer of every cell reaches from the bottom to the top.
bool is_block(const Stock& stock);

}  // namespace polypod::cutting
