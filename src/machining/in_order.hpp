// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What one thread makes and another works on, in its order.
#pragma once

#include <array>
#include <condition_variable>
#include <cstddef>
#include <exception>
#include <functional>
#include <mutex>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

namespace polypod::machining {

/// Takes items one after the other and works on them in that order: the first thousands at once, what follows on a
/// second thread where there is one. What comes of it does not depend on the threads. Whatever the work uses belongs to
/// it until `finish`, which waits for all that was taken; an exception of the work comes out of it.
template <class Item>
class InOrder {
 public:
  using Work = std::function<void(const Item&)>;
  explicit InOrder(Work work) : work_(std::move(work)), alone_(std::thread::hardware_concurrency() < 2) {}
  InOrder(const InOrder&) = delete;
  InOrder& operator=(const InOrder&) = delete;
  InOrder(InOrder&&) = delete;
  InOrder& operator=(InOrder&&) = delete;
  ~InOrder() { end(); }

  void take(const Item& item) {
    if (!worker_.joinable() && (alone_ || taken_++ < kAtOnce || !start())) {
      work_(item);
      return;
    }
    std::vector<Item>& batch = batches_[filled_ % kBatches];
    batch.push_back(item);
    if (batch.size() == kBatch) hand_over();
  }

  void finish() {
    end();
    if (failed_) std::rethrow_exception(std::exchange(failed_, nullptr));
  }

 private:
  static constexpr std::size_t kAtOnce = 4096, kBatch = 128, kBatches = 8;

  bool start() {
    try {
      worker_ = std::thread([this] { work(); });
    } catch (const std::system_error&) {  // no thread is given
      alone_ = true;
    }
    return !alone_;
  }

  /// The batch that was filled goes to the worker; the next one is free afterwards.
  void hand_over() {
    std::unique_lock lock(mutex_);
    ++filled_;
    changed_.notify_all();
    changed_.wait(lock, [this] { return filled_ - emptied_ < kBatches; });
  }

  void end() {
    if (!worker_.joinable()) return;
    {
      const std::lock_guard lock(mutex_);
      ++filled_;  // what is left may be none
      ended_ = true;
      changed_.notify_all();
    }
    worker_.join();
  }

  void work() {
    std::unique_lock lock(mutex_);
    while (true) {
      changed_.wait(lock, [this] { return emptied_ < filled_ || ended_; });
      if (emptied_ == filled_) return;
      std::vector<Item>& batch = batches_[emptied_ % kBatches];
      lock.unlock();
      try {
        for (const Item& item : batch) {
          if (!failed_) work_(item);
        }
      } catch (...) {
        failed_ = std::current_exception();
      }
      batch.clear();
      lock.lock();
      ++emptied_;
      changed_.notify_all();
    }
  }

  Work work_;
  bool alone_;
  std::size_t taken_ = 0;
  std::array<std::vector<Item>, kBatches> batches_;
  std::size_t filled_ = 0, emptied_ = 0;  // batches, ever
  bool ended_ = false;
  std::exception_ptr failed_;  // of the worker
  std::mutex mutex_;
  std::condition_variable changed_;
  std::thread worker_;
};

}  // namespace polypod::machining
