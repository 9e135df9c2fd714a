// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "job_input.hpp"

#include "polypod/machining/unrolling.hpp"

namespace polypod::app {

Result<Input> read_input(const std::string& program_path, const std::string& job_path,
                         const std::vector<std::string>& measured, bool source_lines) {
  POLYPOD_ASSIGN(job, machining::read_job(job_path));
  if (!measured.empty()) {
    POLYPOD_ASSIGN(compliance, machining::read_measured(measured, {}, &job.machine));
    job.measured = std::move(compliance);
  }
  gcode::UnrollOptions options = machining::unroll_options(job);
  options.source_lines = source_lines;
  POLYPOD_ASSIGN(understood, gcode::understand(program_path, options));
  return Input{std::move(job), std::move(understood.program), std::move(understood.interpretation)};
}

}  // namespace polypod::app
