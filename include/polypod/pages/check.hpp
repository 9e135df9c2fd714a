// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The page of a check: the machine on its way along a program, and its joints beside their limits.
#pragma once

#include <string>
#include <vector>

#include "polypod/machining/check.hpp"
#include "polypod/machining/job.hpp"

namespace polypod::pages {

struct CheckPageOptions {
  std::string version;              ///< of Polypod; default: not named
  std::string command;              ///< the command line that makes this page again; default: left out
  double rapid_speed = 0.1;         ///< m/s, as in CheckOptions
  bool with_bodies = false;         ///< whether bodies were judged
  std::vector<std::string> places;  ///< where it would fit, in words
};

/// One self-contained HTML file: the answer, what does not fit and where, the machine that moves along the program with
/// the line and the time, the joints over the time beside their ranges. `result` is what machining::check says of this
/// program. Long programs are thinned out: the page says how many moves a picture stands for. The same input gives the
/// same bytes. Cost: that of another check.
std::string check_page(const machining::Job& job, const gcode::Program& program,
                       const gcode::Interpretation& interpretation, const machining::CheckResult& result,
                       const CheckPageOptions& options = {});

}  // namespace polypod::pages
