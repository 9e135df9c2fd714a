// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Who computes the evaluations of a search: the threads of this process, or others.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "polypod/design/store.hpp"

namespace polypod::design {

/// Gets the number and the evaluation of each row as soon as it is done, on the thread that asked. An error of it ends
/// the work.
using Taken = std::function<Status(std::size_t, Evaluation)>;

/// Computes evaluations. What a row evaluates to must follow from the study, the row and the incumbents alone.
class Crew {
 public:
  Crew() = default;
  Crew(const Crew&) = delete;
  Crew& operator=(const Crew&) = delete;
  virtual ~Crew() = default;
  /// All rows, in any order. False: cancelled; what had been done by then was handed over.
  virtual Result<bool> work(const std::vector<Row>& rows, const Incumbents& incumbents, const Taken& taken) = 0;
};

/// What one row evaluates to: the machine of the study as it is for Phase::start, else the candidate. `threads` are
/// those inside the evaluation. Errors: WS110 (cancelled).
Result<Evaluation> judge(const Study& study, const Row& row, const Incumbents& incumbents,
                         const EvaluateOptions& options);

/// Threads of this process, one evaluation each; a single row gets all of them. `threads` 0: as many as the machine
/// has.
std::unique_ptr<Crew> thread_crew(const Study& study, int threads, std::function<bool()> cancelled);

}  // namespace polypod::design
