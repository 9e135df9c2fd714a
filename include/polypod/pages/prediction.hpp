// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The page of a prediction: how far the tool is deflected along a program, and the machine on its way.
#pragma once

#include <string>
#include <vector>

#include "polypod/machining/predict.hpp"

namespace polypod::pages {

struct PredictionPageOptions {
  std::string version;               ///< of Polypod; default: not named
  std::string command;               ///< the command line that makes this page again; default: left out
  bool within = false;               ///< the answer of the command: every cut was judged and stays in the tube
  bool collides = false;             ///< a rapid goes through material: what is left of the stock is not known
  bool with_vibration = false;       ///< the answer counts it
  std::vector<std::string> against;  ///< why it is no yes beside distances and what was not judged, whole sentences
  std::string weight;                ///< what the weight of the machine does, a sentence; empty: not known
  bool at_rest = false;              ///< predicted without the feedback of the deflection on the cut
};

/// One self-contained HTML file: whether the deflected tool stays in the tube, the machine that moves along the program
/// with the deflected path coloured by its distance and the stock that is left, errors and forces along the path, the
/// moves. `samples` are those of the prediction (PredictOptions::keep_samples); the stock that is left is shown where
/// it was kept (keep_stock). Long programs are thinned out so that peaks survive. The same input gives the same bytes.
std::string prediction_page(const machining::Job& job, const gcode::Program& program,
                            const gcode::Interpretation& interpretation, const machining::Prediction& prediction,
                            LongVector<machining::Sample> samples, const PredictionPageOptions& options = {});

}  // namespace polypod::pages
