// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A stock as a surface in space.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "polypod/cutting/cutter.hpp"
#include "polypod/cutting/stock.hpp"
#include "polypod/report/scene.hpp"

namespace polypod::pages {

/// The heights of a stock over at most `cells` squares a side, with walls down to its bottom, at X_MW, mm. Walls lean
/// by one square; what an earlier set-up hollowed from below is not shown. Cost: one height a square.
report::Mesh stock_mesh(const cutting::Stock& stock, const Pose& X_MW, int cells, const std::string& name);

/// Somewhere on the way of a program.
struct OnTheWay {
  Vec3 tip_W = Vec3::Zero();  ///< m
  double at = 0;              ///< the place of the scene's frames
  const cutting::Cutter* cutter = nullptr;
  bool joined = false;  ///< the tool went straight from the place before to this one
};
/// The mesh of `before`, with the shifts that a cutter makes on its way, an upright one, rounded or flat: a square is
/// lowered where its middle is under the cutter. Each square ends at the height of `after`. Squares that are lowered
/// again and again have at most `most` shifts in all: then those of neighbouring places are one. Cost: some 10 ns a
/// square under the cutter and place.
report::Mesh growing_cut(const cutting::Stock& before, const cutting::Stock& after, const Pose& X_MW, int cells,
                         const std::string& name, const std::vector<OnTheWay>& way, std::size_t most);

}  // namespace polypod::pages
