// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The page that a process engineer reads before she runs a corrected program.
#pragma once

#include <optional>
#include <string>

#include "polypod/machining/confidence.hpp"
#include "polypod/machining/uncertainty.hpp"

namespace polypod::pages {

struct CorrectionPageOptions {
  std::string version;  ///< of Polypod; default: not named
  std::string command;  ///< the command line that makes this page again; default: left out
  std::string output;   ///< where the corrected program was written; empty: it was not
  machining::CorrectMethod method = machining::CorrectMethod::tube;
  std::string weight;                  ///< what the weight of the machine does, a sentence; empty: not known
  machining::Uncertainty uncertainty;  ///< of compliances and machine, where their covariances are known
  std::optional<machining::Confidence> confidence;  ///< how likely the walls are inside; default: left out
};

/// One self-contained HTML file about a correction: verdict, key figures, paths from above with the deflection
/// enlarged, a corner at its true proportions, errors along the path against the tube, forces and engagement, the
/// compliance round the part and each joint's share, the moves, what the model leaves out, every input; with
/// `uncertainty` its U (k = 2), and whether the answer holds with it. Long programs are thinned out
/// for the pictures so that peaks survive (20 000 lines stay below 3 MB).
///
/// `program` is the original, `correction` what `machining::correct` made of it with `keep_samples`; without samples
/// the pictures along the path are left out. Lengths are mm, deflections um, forces N, angles deg. The same input gives
/// the same bytes. Cost: about 0.1 s, of which the compliance map takes most.
std::string correction_page(const machining::Job& job, const gcode::Program& program,
                            const machining::Correction& correction, const CorrectionPageOptions& options = {});

}  // namespace polypod::pages
