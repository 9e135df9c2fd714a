// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/design/crew.hpp"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <deque>
#include <exception>
#include <mutex>
#include <optional>
#include <thread>

#include "polypod/design/cell_study.hpp"

namespace polypod::design {
namespace {

constexpr const char* kCancelled = "WS110";

Result<bool> ended(const Error& error) {
  if (error.id == kCancelled) return false;
  return tl::unexpected(error);
}

/// One batch.
class Batch {
 public:
  Batch(const Study& study, const std::vector<Row>& rows, const Incumbents& incumbents,
        const std::function<bool()>& cancelled)
      : study_(study), rows_(rows), incumbents_(incumbents), cancelled_(cancelled) {}

  Result<bool> work(std::size_t count, const Taken& taken) {
    std::vector<std::thread> threads;
    const auto join = [&] {
      stop_ = true;
      for (std::thread& t : threads) t.join();
    };
    try {
      for (std::size_t k = 0; k < count; ++k) threads.emplace_back([&] { help(); });
    } catch (...) {
      if (threads.empty()) throw;  // else those that could be started do the work
    }
    std::optional<Error> failed;
    for (std::size_t got = 0; got < rows_.size() && !failed; ++got) {
      Done done = next();
      if (done.thrown) {
        join();
        std::rethrow_exception(done.thrown);
      }
      if (!done.evaluation) {
        failed = done.evaluation.error();
      } else if (const Status status = taken(done.index, std::move(*done.evaluation)); !status) {
        failed = status.error();
      }
    }
    join();
    if (failed) {
      if (failed->id == kCancelled) POLYPOD_TRY(keep_what_is_done(taken));
      return ended(*failed);
    }
    return true;
  }

 private:
  struct Done {
    std::size_t index = 0;
    Result<Evaluation> evaluation;
    std::exception_ptr thrown;
  };

  /// What the others had done when one of them was cancelled.
  Status keep_what_is_done(const Taken& taken) {
    for (Done& done : done_)
      if (!done.thrown && done.evaluation) POLYPOD_TRY(taken(done.index, std::move(*done.evaluation)));
    return {};
  }

  void help() {
    while (!stop_) {
      const std::size_t i = next_++;
      if (i >= rows_.size()) return;
      Done done{i, {}, nullptr};
      try {
        done.evaluation =
            judge(study_, rows_[i], incumbents_, {1, [this] { return stop_ || (cancelled_ && cancelled_()); }});
      } catch (...) {
        done.thrown = std::current_exception();
      }
      const std::lock_guard guard(mutex_);
      done_.push_back(std::move(done));
      ready_.notify_one();
    }
  }

  Done next() {
    std::unique_lock lock(mutex_);
    ready_.wait(lock, [this] { return !done_.empty(); });
    Done out = std::move(done_.front());
    done_.pop_front();
    return out;
  }

  const Study& study_;
  const std::vector<Row>& rows_;
  const Incumbents& incumbents_;
  const std::function<bool()>& cancelled_;
  std::atomic<bool> stop_{false};
  std::atomic<std::size_t> next_{0};
  std::mutex mutex_;
  std::condition_variable ready_;
  std::deque<Done> done_;
};

class Threads final : public Crew {
 public:
  Threads(const Study& study, int threads, std::function<bool()> cancelled)
      : study_(study), threads_(threads), cancelled_(std::move(cancelled)) {}

  Result<bool> work(const std::vector<Row>& rows, const Incumbents& incumbents, const Taken& taken) override {
    const std::size_t most =
        threads_ > 0 ? static_cast<std::size_t>(threads_) : std::max(1U, std::thread::hardware_concurrency());
    const std::size_t count = std::min(most, rows.size());
    if (count > 1) return Batch(study_, rows, incumbents, cancelled_).work(count, taken);
    for (std::size_t i = 0; i < rows.size(); ++i) {
      auto done = judge(study_, rows[i], incumbents, {threads_, cancelled_});
      if (!done) return ended(done.error());
      POLYPOD_TRY(taken(i, std::move(*done)));
    }
    return true;
  }

 private:
  const Study& study_;
  int threads_;
  std::function<bool()> cancelled_;
};

}  // namespace

Result<Evaluation> judge(const Study& study, const Row& row, const Incumbents& incumbents,
                         const EvaluateOptions& options) {
  if (options.cancelled && options.cancelled()) return fail(kCancelled, "cancelled");
  if (row.phase == Phase::start && study.of_cell) return evaluate_cell(study, nullptr, options);
  if (row.phase == Phase::start) return evaluate_machine(study, study.start, {}, options);
  return evaluate(study, row.varied, incumbents, options);
}

std::unique_ptr<Crew> thread_crew(const Study& study, int threads, std::function<bool()> cancelled) {
  return std::make_unique<Threads>(study, threads, std::move(cancelled));
}

}  // namespace polypod::design
