// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a job tells the reader of G-code.
#pragma once

#include "polypod/gcode/unroll.hpp"
#include "polypod/machining/job.hpp"

namespace polypod::machining {

/// Work offsets, block delete, and the diameters of the job's cutters, which G41 and G42 compensate.
inline gcode::UnrollOptions unroll_options(const Job& job) {
  gcode::UnrollOptions options;
  options.interpret = job.interpret_options();
  options.diameter = job.cutter.diameter;
  for (const auto& [tool, cutter] : job.cutters) options.diameters[tool] = cutter.diameter;
  return options;
}

}  // namespace polypod::machining
