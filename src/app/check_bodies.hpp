// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What `check --bodies` asks of bodies.
#pragma once

#include <string>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/machining/check.hpp"
#include "polypod/machining/job.hpp"

namespace polypod::app {

using BodyNotes = std::vector<std::string>;

/// Makes `options` ask which bodies of the file touch; from the job, where it gives them (`job_cuts`), come the cutters
/// and the box of the stock. Returns what is judged and what is not.
Result<BodyNotes> watch_bodies(const std::string& file, const machining::Job& job, bool job_cuts,
                               machining::CheckOptions& options);

}  // namespace polypod::app
