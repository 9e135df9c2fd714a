// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A program and its job, as predict, correct, place and others read them.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "command.hpp"
#include "polypod/gcode/unroll.hpp"
#include "polypod/machining/job.hpp"

namespace polypod::app {

struct Input {
  machining::Job job;
  gcode::Program program;
  gcode::Interpretation interpretation;
  /// With the other position of block delete, where the program was unrolled and has blocks with /.
  std::optional<gcode::Understood> other;

  [[nodiscard]] const gcode::Understood* other_position() const { return other ? &*other : nullptr; }
};

inline constexpr const char* kMeasuredHelp =
    "Measured displacements (the files of identify compliance): the compliance is interpolated from these alone, "
    "without the joints' (repeatable; default: the job's)";

inline constexpr const char* kBranchHelp =
    "The posture to begin with, as `polypod ik` names it (default: `branch` of the job, else that of its start_joints, "
    "else the first within the limits)";

/// The posture of `--branch`, if it is given, in the place of the job's. Error: AP123, the first pose of the program
/// has no solution within the limits in that posture; for the job's own only where it has others. And choose_start, in
/// a note of the interpretation.
Status begin_in(const std::string& branch, gcode::Interpretation& interpretation, machining::Job& job);
/// The posture in which a program is judged: that of the job, else the first that keeps the limits at the start. Empty
/// where the machine has one there, or does not reach it.
std::string posture_at_start(const machining::Job& job, const gcode::Interpretation& interpretation);

/// `measured`: files in the place of the job's measured compliance, if there are any.
Result<Input> read_input(const Context& context, const std::string& program_path, const std::string& job_path,
                         const std::vector<std::string>& measured = {}, bool source_lines = false);

/// Fills `other` of a program that was not unrolled, too.
Status read_other_position(Input& in);

}  // namespace polypod::app
