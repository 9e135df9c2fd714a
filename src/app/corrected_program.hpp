// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The plan of a program that `polypod correct` wrote: right for one machine, one place and one way to hold the tool.
#pragma once

#include <optional>
#include <string>

#include "polypod/core/error.hpp"
#include "polypod/machining/job.hpp"
#include "polypod/post/plan.hpp"

namespace polypod::app {

/// What the command line of `post` says of how the machine holds the tool.
struct HoldSaid {
  std::string config, branch, c, external;
  bool gives_c = false, gives_external = false, gives_start = false;
  bool allow_problems = false;
};

class CorrectedProgram {
 public:
  /// `given`: the job; `job`: the same in the frame of G54, as the path is. Error: PO125 it was corrected for another
  /// machine or place.
  static Result<CorrectedProgram> of(const post::Path& path, const machining::Job& given, const machining::Job& job);

  /// What is not known of that; empty where all is, or nothing was corrected.
  [[nodiscard]] const std::string& not_judged() const { return not_judged_; }
  /// Whether the header says how the tool is held, and the plan keeps it.
  [[nodiscard]] bool holds() const { return holds_; }

  /// Posture, C and external axis of the header, where the command line does not say others. Error: PO128 it does.
  Status take_hold(const post::Configuration& configuration, const HoldSaid& said, post::PlanOptions& p);
  /// The plan, with what take_hold found. Where the joints before the program lead elsewhere than those of the header,
  /// it begins with these, with a note, unless the command line says them. Errors: those of post::plan; PO128.
  [[nodiscard]] Result<post::Plan> plan(const post::Configuration& configuration, const post::PlanOptions& with,
                                        const HoldSaid& said) const;

 private:
  CorrectedProgram(const post::Path& path, const machining::Job& given, const machining::Job& job)
      : path_(path), given_(given), job_(job) {}

  [[nodiscard]] Error not_as_corrected(std::string message, std::string hint) const;
  [[nodiscard]] Result<post::Plan> plan_held(const post::Configuration& configuration, const post::PlanOptions& with,
                                             bool allow_problems) const;
  /// Where a plan comes to the place of the mark with other joints than those with which the program was corrected, so
  /// that the tool deflects otherwise there: why it is refused. Of a machine whose poses leave a joint free.
  [[nodiscard]] std::optional<Error> other_joints(const post::Plan& plan) const;

  const post::Path& path_;
  const machining::Job &given_, &job_;
  std::optional<gcode::CorrectionHeader> header_;
  std::string not_judged_;
  bool holds_ = false;
  bool unreached_ = false;  ///< the machine does not hold its tool as the header says where the first cut begins
};

}  // namespace polypod::app
