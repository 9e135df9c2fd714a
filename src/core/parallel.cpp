// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/core/parallel.hpp"

#include <tbb/blocked_range.h>
#include <tbb/info.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>

namespace polypod {

bool for_each_in_rounds(std::size_t count, const ParallelOptions& options, const std::function<void(std::size_t)>& task,
                        std::size_t grain) {
  constexpr std::size_t kLeastRound = 256;
  const std::size_t round = std::max(kLeastRound, count / 100 + 1);
  // More threads than cores serve nobody, and TBB says so on stderr.
  const int cores = tbb::info::default_concurrency();
  tbb::task_arena arena(options.threads > 0 ? std::min(options.threads, cores) : cores);
  for (std::size_t first = 0; first < count; first += round) {
    if (options.cancelled && options.cancelled()) return false;
    const std::size_t end = std::min(count, first + round);
    arena.execute([&] {
      tbb::parallel_for(tbb::blocked_range<std::size_t>(first, end, grain), [&](const auto& range) {
        for (std::size_t i = range.begin(); i < range.end(); ++i) task(i);
      });
    });
    if (options.progress) options.progress(static_cast<double>(end) / static_cast<double>(count));
  }
  return true;
}

}  // namespace polypod
