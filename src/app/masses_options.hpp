// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "commands.hpp"
#include "polypod/machining/job.hpp"
#include "polypod/motion/dynamics.hpp"

namespace polypod::app {

/// The masses of a machine, and what its drives can give.
struct Masses {
  std::optional<motion::Dynamics> dynamics;
  machine::JointVector force;  ///< N or Nm; empty: not limited
  std::string why_not;         ///< why there are no forces
};

/// What of the machine has mass, and where gravity points, for people.
std::string in_words(const motion::Dynamics& dynamics);

struct MassesOptions {
  std::string dynamics, drive_force;
  void declare(Arguments& a);
  /// Of --dynamics, else of the machine's own file. Errors: AP107, AP210, AP214, those of reading --dynamics and of the
  /// table.
  [[nodiscard]] Result<Masses> read(const machine::AnyMachine& m, const std::string& machine_file,
                                    const Context& context) const;
};

/// The file of a job's machine, or its name in the catalogue.
std::string machine_file_of(const machining::Job& job);
/// The masses of a job's machine, of the file `dynamics` if it is named.
Result<Masses> masses_of_job(const machining::Job& job, const std::string& dynamics, const Context& context);

}  // namespace polypod::app
