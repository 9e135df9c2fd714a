// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Many independent tasks on all cores, with progress and a way out.
#pragma once

#include <cstddef>
#include <functional>

namespace polypod {

struct ParallelOptions {
  int threads = 0;                       ///< 0: as many as the machine has
  std::function<bool()> cancelled;       ///< asked between rounds
  std::function<void(double)> progress;  ///< share of the work, from the calling thread
};

/// Runs task(i) for i = 0 .. count - 1 in rounds of a hundredth, `grain` neighbours on one thread. The tasks must not
/// depend on each other; what they write is then the same for any number of threads. False if it was cancelled.
bool for_each_in_rounds(std::size_t count, const ParallelOptions& options, const std::function<void(std::size_t)>& task,
                        std::size_t grain = 8);

}  // namespace polypod
