// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Work that the caller does not wait for, on a second thread where there is one.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <future>
#include <optional>
#include <system_error>
#include <thread>
#include <utility>

#include "polypod/core/error.hpp"
#include "polypod/machining/accept.hpp"

namespace polypod::machining {

/// A task beside the work of its maker. Where there is no second processor, or no thread is given, it is done at once,
/// with the given report of progress. Whatever the task uses must outlive this.
class Aside {
 public:
  using Progress = std::function<bool(double)>;
  /// Reports the share that is done, and stops where that is answered with false.
  using Task = std::function<Status(const Progress&)>;

  Aside(const Task& task, const Progress& progress) {
    if (std::thread::hardware_concurrency() > 1) {
      try {
        running_ = std::async(std::launch::async, [this, work = task] {
          Status done = work([this](double share) {
            share_.store(share, std::memory_order_relaxed);
            return !stop_.load(std::memory_order_relaxed);
          });
          failed_ = !done;
          return done;
        });
        return;
      } catch (const std::system_error&) {  // no thread is given
      }
    }
    done_ = task(progress);
    failed_ = !*done_;
  }
  Aside(const Aside&) = delete;
  Aside& operator=(const Aside&) = delete;
  Aside(Aside&&) = delete;
  Aside& operator=(Aside&&) = delete;
  ~Aside() {
    stop_ = true;
    if (running_.valid()) running_.wait();  // an exception of the work, as of no memory, goes nowhere
  }

  /// What became of it; waits, and reports progress meanwhile. Once known it may be asked for again.
  Status result(const Progress& progress) {
    constexpr std::chrono::milliseconds kReportEvery{50};
    while (running_.valid() && running_.wait_for(kReportEvery) != std::future_status::ready) {
      if (progress && !progress(share_.load(std::memory_order_relaxed))) stop_ = true;
    }
    if (running_.valid()) done_ = running_.get();
    return *done_;
  }
  /// The progress of work that is in vain once this has failed: it is stopped then.
  [[nodiscard]] Progress unless_failed(Progress progress) const {
    return [this, report = std::move(progress)](double share) { return !failed_ && (!report || report(share)); };
  }
  /// Ends it; nobody asks for its result.
  void stop() {
    stop_ = true;
    if (running_.valid()) done_ = running_.get();
  }

 private:
  std::atomic<bool> stop_{false}, failed_{false};
  std::atomic<double> share_{0};
  std::future<Status> running_;
  std::optional<Status> done_;
};

/// What `accept` asks but for the reach, which takes the time: accept_reach, aside.
Result<Accepted> accept_but_reach(const Job& job, const gcode::Program& program,
                                  const gcode::Interpretation& interpretation, bool again);

}  // namespace polypod::machining
