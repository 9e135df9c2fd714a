// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the pages of a prediction and of a correction say alike.
#pragma once

#include <string>
#include <vector>

#include "correction_figures.hpp"
#include "polypod/machining/predict.hpp"
#include "polypod/report/html.hpp"

namespace polypod::pages {

/// A sentence of the answer with the sign that pages have for micrometres.
std::string with_sign(std::string text);

/// What was not judged of the cut, each where there is some. `at`: " with block delete on", or nothing.
void add_not_judged(report::Report& report, const machining::Steep& steep, const std::string& at);
void add_not_judged(report::Report& report, const machining::SlowCorners& slow, const std::string& at);
void add_not_judged(report::Report& report, const std::vector<machining::Plunge>& plunges, const std::string& at);

/// What the other position of block delete comes to, with what was not judged there. `correction`: a position for which
/// the program was unrolled was judged with a correction of its own.
void add_other_position(report::Report& report, const machining::OtherSwitch& other, bool correction);

/// Distance, normal and vertical error along the path; `rests`: what the distance is to the answer, a clause with a
/// colon, or nothing.
void add_error_plots(report::Report& report, const machining::Correction& c, const Tracks& tracks,
                     const std::string& rests);

}  // namespace polypod::pages
