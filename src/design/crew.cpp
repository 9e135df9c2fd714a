// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/design/crew.hpp"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <deque>
#include <exception>
#include <mutex>
#include <thread>

#include "polypod/design/cell_study.hpp"

namespace polypod::design {
namespace {

constexpr const char* kCancelled = "WS110";

Result<bool> ended(const Error& error) {
  if (error.id == kCancelled) return false;
  return tl::unexpected(error);
}

/// Threads that compute what is put before them.
class Pool {
 public:
  struct Done {
    std::size_t index = 0;
    Result<Evaluation> evaluation;
    std::exception_ptr thrown;
  };

  Pool(const Study& study, std::size_t count, const std::function<bool()>& cancelled)
      : study_(study), cancelled_(cancelled) {
    try {
      for (std::size_t k = 0; k < count; ++k) threads_.emplace_back([this] { help(); });
    } catch (...) {
      if (threads_.empty()) throw;  // else those that could be started do the work
    }
  }
  Pool(const Pool&) = delete;
  Pool& operator=(const Pool&) = delete;
  ~Pool() { stop(); }

  void add(Task task) {
    const std::lock_guard guard(mutex_);
    tasks_.push_back(std::move(task));
    there_.notify_one();
  }
  /// Waits for it.
  Done next() {
    std::unique_lock lock(mutex_);
    ready_.wait(lock, [this] { return !done_.empty(); });
    Done out = std::move(done_.front());
    done_.pop_front();
    return out;
  }
  /// Ends what is being computed.
  void stop() {
    {
      const std::lock_guard guard(mutex_);
      stop_ = true;
      there_.notify_all();
    }
    for (std::thread& t : threads_) t.join();
    threads_.clear();
  }
  /// What had been done when it was stopped.
  std::deque<Done>& done() { return done_; }

 private:
  void help() {
    while (true) {
      std::unique_lock lock(mutex_);
      there_.wait(lock, [this] { return stop_ || !tasks_.empty(); });
      if (stop_) return;
      const Task task = std::move(tasks_.front());
      tasks_.pop_front();
      lock.unlock();
      Done done{task.index, {}, nullptr};
      try {
        done.evaluation = judge(study_, task, {1, [this] { return stop_ || (cancelled_ && cancelled_()); }});
      } catch (...) {
        done.thrown = std::current_exception();
      }
      lock.lock();
      done_.push_back(std::move(done));
      ready_.notify_one();
    }
  }

  const Study& study_;
  const std::function<bool()>& cancelled_;
  std::atomic<bool> stop_{false};
  std::mutex mutex_;
  std::condition_variable there_, ready_;
  std::deque<Task> tasks_;
  std::deque<Done> done_;
  std::vector<std::thread> threads_;
};

class Threads final : public Crew {
 public:
  Threads(const Study& study, int threads, std::function<bool()> cancelled)
      : study_(study), threads_(threads), cancelled_(std::move(cancelled)) {}

  Result<bool> work(Tasks& tasks) override {
    const std::size_t count =
        threads_ > 0 ? static_cast<std::size_t>(threads_) : std::max(1U, std::thread::hardware_concurrency());
    std::optional<Pool> pool;
    std::size_t in_work = 0;
    while (true) {
      std::vector<Task> fresh;
      const std::size_t most = count > 1 ? count + 1 : 1;
      while (in_work + fresh.size() < most) {
        std::optional<Task> task = tasks.next();
        if (!task) break;
        fresh.push_back(std::move(*task));
      }
      if (in_work + fresh.size() == 0) return true;
      if (in_work == 0 && fresh.size() == 1) {
        auto done = judge(study_, fresh[0], {threads_, cancelled_});
        if (!done) return ended(done.error());
        POLYPOD_TRY(tasks.taken(fresh[0].index, std::move(*done)));
        continue;
      }
      if (!pool) pool.emplace(study_, count, cancelled_);
      in_work += fresh.size();
      for (Task& task : fresh) pool->add(std::move(task));
      Pool::Done done = pool->next();
      --in_work;
      if (done.thrown) std::rethrow_exception(done.thrown);
      if (!done.evaluation) {
        pool->stop();
        if (done.evaluation.error().id == kCancelled) POLYPOD_TRY(keep(pool->done(), tasks));
        return ended(done.evaluation.error());
      }
      POLYPOD_TRY(tasks.taken(done.index, std::move(*done.evaluation)));
    }
  }

 private:
  static Status keep(std::deque<Pool::Done>& all, Tasks& tasks) {
    for (Pool::Done& done : all)
      if (!done.thrown && done.evaluation) POLYPOD_TRY(tasks.taken(done.index, std::move(*done.evaluation)));
    return {};
  }

  const Study& study_;
  int threads_;
  std::function<bool()> cancelled_;
};

class List final : public Tasks {
 public:
  List(const std::vector<Row>& rows, int resolution, const Taken& taken)
      : rows_(rows), resolution_(resolution), taken_(taken) {}
  std::optional<Task> next() override {
    if (next_ >= rows_.size()) return std::nullopt;
    const std::size_t i = next_++;
    return Task{i, rows_[i], {}, resolution_};
  }
  Status taken(std::size_t index, Evaluation evaluation) override { return taken_(index, std::move(evaluation)); }

 private:
  const std::vector<Row>& rows_;
  int resolution_;
  const Taken& taken_;
  std::size_t next_ = 0;
};

}  // namespace

Result<bool> Crew::work(const std::vector<Row>& rows, int resolution, const Taken& taken) {
  List list(rows, resolution, taken);
  return work(list);
}

Result<Evaluation> judge(const Study& study, const Task& task, const EvaluateOptions& options) {
  if (options.cancelled && options.cancelled()) return fail(kCancelled, "cancelled");
  if (task.resolution > 0 && task.resolution != study.resolution) {
    Study finer = study;
    finer.resolution = task.resolution;
    return judge(finer, task, options);
  }
  if (task.row.phase == Phase::start && study.of_cell) return evaluate_cell(study, nullptr, options);
  if (task.row.phase == Phase::start) return evaluate_machine(study, study.start, {}, options);
  return evaluate(study, task.row.varied, task.incumbents, options);
}

std::unique_ptr<Crew> thread_crew(const Study& study, int threads, std::function<bool()> cancelled) {
  return std::make_unique<Threads>(study, threads, std::move(cancelled));
}

}  // namespace polypod::design
