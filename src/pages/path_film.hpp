// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The machine on its way along a program whose deflection is known.
#pragma once

#include "correction_figures.hpp"
#include "polypod/report/html.hpp"

namespace polypod::pages {

/// Adds the scene: the machine that moves along the program in M, the deflected paths coloured by their distance and
/// enlarged by `factor`, the stock before and, where it is known, `left`. The curves over the path in the same page get
/// a cursor. False where the machine gets nowhere, and nothing is added. Cost: an inverse a millimetre, at most 20 000.
bool add_path_film(report::Report& report, const machining::Job& job, const gcode::Program& program,
                   const machining::Correction& c, const Tracks& tracks, double factor, const cutting::Stock* left);

}  // namespace polypod::pages
