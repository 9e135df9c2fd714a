// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Who computes the evaluations of a search: the threads of this process, or others.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "polypod/design/store.hpp"

namespace polypod::design {

/// One row to evaluate. What it evaluates to follows from the study and the task alone.
struct Task {
  std::size_t index = 0;  ///< under which its evaluation is handed over
  Row row;
  Incumbents incumbents;
  int resolution = 0;  ///< points a side of its survey; 0: as many as the study says
};

/// Tasks one after another. A later one may follow from the evaluations of those before.
class Tasks {
 public:
  Tasks() = default;
  Tasks(const Tasks&) = delete;
  Tasks& operator=(const Tasks&) = delete;
  virtual ~Tasks() = default;
  /// Nothing: not before the next evaluation is handed over, or, where no task is being computed, never again.
  virtual std::optional<Task> next() = 0;
  /// An evaluation, as soon as it is done, on the thread that asked. An error of it ends the work.
  virtual Status taken(std::size_t index, Evaluation evaluation) = 0;
};

/// Gets the number and the evaluation of each row of a list.
using Taken = std::function<Status(std::size_t, Evaluation)>;

/// Computes evaluations.
class Crew {
 public:
  Crew() = default;
  Crew(const Crew&) = delete;
  Crew& operator=(const Crew&) = delete;
  virtual ~Crew() = default;
  /// All tasks, done in any order; as many are fetched as are computed at a time, and one more. False: cancelled; what
  /// had been done by then was handed over.
  virtual Result<bool> work(Tasks& tasks) = 0;
  /// The rows of a list, over surveys of `resolution` points a side, 0: as the study says.
  Result<bool> work(const std::vector<Row>& rows, int resolution, const Taken& taken);
};

/// What one row evaluates to: the machine of the study as it is for Phase::start, else the candidate. `threads` are
/// those inside the evaluation. Errors: WS110 (cancelled).
Result<Evaluation> judge(const Study& study, const Task& task, const EvaluateOptions& options);

/// Threads of this process, one evaluation each; a task that is alone gets all of them. `threads` 0: as many as the
/// machine has.
std::unique_ptr<Crew> thread_crew(const Study& study, int threads, std::function<bool()> cancelled);

}  // namespace polypod::design
