// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "job_input.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "busy_line.hpp"
#include "polypod/machining/accept.hpp"
#include "polypod/machining/beginning.hpp"
#include "polypod/machining/check.hpp"
#include "polypod/machining/unrolling.hpp"

namespace polypod::app {

Result<Input> read_input(const Context& context, const std::string& program_path, const std::string& job_path,
                         const std::vector<std::string>& measured, bool source_lines) {
  const BusyLine busy(context, "reading the program and the job");
  POLYPOD_ASSIGN(job, machining::read_job(job_path));
  if (!measured.empty()) {
    POLYPOD_ASSIGN(compliance, machining::read_measured(measured, {}, &job.machine));
    job.measured = std::move(compliance);
  }
  gcode::UnrollOptions options = machining::unroll_options(job);
  options.source_lines = source_lines;
  POLYPOD_ASSIGN(source, gcode::read(program_path));
  std::optional<gcode::Understood> other;
  if (machining::has_optional_blocks(source) && gcode::needs_unrolling(source)) {
    gcode::UnrollOptions turned = options;
    turned.interpret.block_delete = !job.block_delete;
    Result<gcode::Understood> found = gcode::understand(source, turned);
    if (!found) return tl::unexpected(machining::at_switch(std::move(found.error()), turned.interpret.block_delete));
    other = std::move(*found);
  }
  POLYPOD_ASSIGN(understood, gcode::understand(std::move(source), options));
  return Input{std::move(job), std::move(understood.program), std::move(understood.interpretation), std::move(other)};
}

std::string posture_at_start(const machining::Job& job, const gcode::Interpretation& interpretation) {
  const std::vector<std::string> names = machining::starting_branches(job.machine, job.X_MW, interpretation);
  if (names.size() < 2) return {};
  return job.posture.empty() ? names.front() : job.posture;
}

namespace {
Status has_posture(const std::string& branch, const gcode::Interpretation& interpretation, const machining::Job& job) {
  if (job.posture.empty()) return {};
  const std::vector<std::string> names = machining::starting_branches(job.machine, job.X_MW, interpretation);
  // Where there is none at all the program is out of reach, which is said with its line.
  if (names.empty() && branch.empty()) return {};
  if (std::find(names.begin(), names.end(), job.posture) != names.end()) return {};
  return fail("AP123",
              fmt::format("{} {}: there is no such posture within the limits at the start",
                          branch.empty() ? "the posture of the job," : "--branch", job.posture),
              {branch.empty() ? job.path : ""},
              !names.empty()                          ? fmt::format("there are {}", fmt::join(names, ", "))
              : job.posture.rfind("numeric-", 0) == 0 ? "solutions of a search have numbers at one pose, no names "
                                                        "along a path: give the job the `start_joints` of one"
                                                      : "`polypod ik` lists those of a pose");
}
}  // namespace

Status begin_in(const std::string& branch, gcode::Interpretation& interpretation, machining::Job& job) {
  if (!branch.empty() && branch != job.posture) {
    job.posture = branch;
    job.start_joints.clear();  // which stand in another one
  }
  POLYPOD_TRY(has_posture(branch, interpretation, job));
  if (std::string note = machining::choose_start(interpretation, job); !note.empty())
    interpretation.notes.push_back(std::move(note));
  return {};
}

Status read_other_position(Input& in) {
  if (in.other || !machining::has_optional_blocks(in.program)) return {};
  gcode::InterpretOptions options = in.job.interpret_options();
  options.block_delete = !in.job.block_delete;
  Result<gcode::Interpretation> run = gcode::interpret(in.program, options);
  if (!run) return tl::unexpected(machining::at_switch(std::move(run.error()), options.block_delete));
  if (Status known = machining::known_offsets(in.job, in.program, *run); !known)
    return tl::unexpected(machining::at_switch(std::move(known.error()), options.block_delete));
  in.other = gcode::Understood{in.program, std::move(*run), false};
  return {};
}

}  // namespace polypod::app
