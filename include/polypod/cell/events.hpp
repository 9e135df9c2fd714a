// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Simulation of discrete events: processes that wait for time, for signals, for resources and for buffers.
//
// A process is a coroutine that returns `Process` and takes what it works on by reference or value:
//
//   Process customer(Simulation& sim, Resource& server, double service) {
//     co_await server.take("customer");
//     co_await sim.wait(service);
//     server.give("customer");
//   }
//   sim.start(customer(sim, server, 1.5));
//   sim.run(3600);
//
// Events at one time happen in the order in which they were planned, so that a run depends on its inputs alone.
#pragma once

#include <coroutine>
#include <cstdint>
#include <deque>
#include <exception>
#include <limits>
#include <memory>
#include <queue>
#include <string>
#include <utility>
#include <vector>

namespace polypod::cell {

class Simulation;

/// A process, not yet started. Simulation::start takes it; its frame then lives as long as the simulation. A process
/// may wait for another one to its end: `co_await other(...)`.
class Process {
 public:
  struct promise_type {
    std::coroutine_handle<> after;  ///< who waits for its end
    Process get_return_object() { return Process(std::coroutine_handle<promise_type>::from_promise(*this)); }
    std::suspend_always initial_suspend() noexcept { return {}; }
    struct End {
      [[nodiscard]] bool await_ready() const noexcept { return false; }
      std::coroutine_handle<> await_suspend(std::coroutine_handle<promise_type> ended) const noexcept {
        return ended.promise().after ? ended.promise().after : std::noop_coroutine();
      }
      void await_resume() const noexcept {}
    };
    End final_suspend() noexcept { return {}; }
    void return_void() {}
    void unhandled_exception() { std::terminate(); }
  };
  Process(Process&& other) noexcept : handle_(std::exchange(other.handle_, nullptr)) {}
  Process& operator=(Process&&) = delete;
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;
  ~Process() {
    if (handle_) handle_.destroy();
  }
  [[nodiscard]] bool await_ready() const noexcept { return false; }
  std::coroutine_handle<> await_suspend(std::coroutine_handle<> after) const noexcept {
    handle_.promise().after = after;
    return handle_;
  }
  void await_resume() const noexcept {}

 private:
  friend class Simulation;
  explicit Process(std::coroutine_handle<promise_type> handle) : handle_(handle) {}
  std::coroutine_handle<promise_type> release() { return std::exchange(handle_, nullptr); }
  std::coroutine_handle<promise_type> handle_;
};

/// Someone who waits: woken once, by whatever comes first.
struct Waiter {
  std::coroutine_handle<> handle;
  bool woken = false;
  bool signalled = false;  ///< by a signal and not by time
};

/// The calendar.
class Simulation {
 public:
  Simulation() = default;
  ~Simulation();
  Simulation(const Simulation&) = delete;
  Simulation& operator=(const Simulation&) = delete;

  [[nodiscard]] double now() const { return now_; }
  /// Begins the process at the present time, after what is planned for it already.
  void start(Process process);
  /// Runs until the time `until`, or until nothing more is planned (then `idle()`); time ends at `until` either way.
  void run(double until);
  [[nodiscard]] bool idle() const { return calendar_.empty(); }
  /// When the last event happened.
  [[nodiscard]] double last_event() const { return last_; }
  [[nodiscard]] std::uint64_t events() const { return events_; }

  /// `co_await sim.wait(dt)`: dt >= 0 seconds.
  auto wait(double dt) { return Delay{*this, dt}; }

  void plan(double time, std::shared_ptr<Waiter> waiter);

 private:
  struct Delay {
    Simulation& sim;
    double dt;
    [[nodiscard]] bool await_ready() const noexcept { return false; }
    void await_suspend(std::coroutine_handle<> handle) const {
      sim.plan(sim.now_ + (dt > 0 ? dt : 0), std::make_shared<Waiter>(Waiter{handle}));
    }
    void await_resume() const noexcept {}
  };
  struct Entry {
    double time;
    std::uint64_t order;
    std::shared_ptr<Waiter> waiter;
    bool operator>(const Entry& other) const { return time != other.time ? time > other.time : order > other.order; }
  };
  double now_ = 0, last_ = 0;
  std::uint64_t planned_ = 0, events_ = 0;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> calendar_;
  std::vector<std::coroutine_handle<>> frames_;
};

/// Wakes all who wait for it.
class Signal {
 public:
  explicit Signal(Simulation& sim) : sim_(sim) {}
  /// `co_await signal.wait(longest)`: true if it was signalled, false if `longest` seconds passed before.
  auto wait(double longest = std::numeric_limits<double>::infinity()) { return Wait{*this, longest, nullptr}; }
  void notify();

 private:
  struct Wait {
    Signal& signal;
    double longest;
    std::shared_ptr<Waiter> waiter;
    [[nodiscard]] bool await_ready() const noexcept { return false; }
    void await_suspend(std::coroutine_handle<> handle) {
      waiter = std::make_shared<Waiter>(Waiter{handle});
      signal.waiters_.push_back(waiter);
      if (longest < std::numeric_limits<double>::infinity()) {
        signal.sim_.plan(signal.sim_.now() + (longest > 0 ? longest : 0), waiter);
      }
    }
    [[nodiscard]] bool await_resume() const noexcept { return waiter->signalled; }
  };
  Simulation& sim_;
  std::vector<std::shared_ptr<Waiter>> waiters_;
};

/// `capacity` servers of which each serves one; who comes first is served first.
class Resource {
 public:
  Resource(Simulation& sim, std::string name, int capacity = 1)
      : sim_(sim), name_(std::move(name)), capacity_(capacity) {}
  /// `co_await resource.take("who")`.
  auto take(std::string who) { return Take{*this, std::move(who)}; }
  void give(const std::string& who);
  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] bool is_free() const { return static_cast<int>(holders_.size()) < capacity_; }
  [[nodiscard]] const std::vector<std::string>& holders() const { return holders_; }
  [[nodiscard]] std::size_t queue() const { return waiting_.size(); }
  /// Seconds of service so far, of all servers.
  [[nodiscard]] double busy() const { return busy_ + static_cast<double>(holders_.size()) * (sim_.now() - since_); }

 private:
  void account() {
    busy_ += static_cast<double>(holders_.size()) * (sim_.now() - since_);
    since_ = sim_.now();
  }
  struct Take {
    Resource& resource;
    std::string who;
    [[nodiscard]] bool await_ready() const {
      if (!resource.is_free() || !resource.waiting_.empty()) return false;
      resource.account();
      resource.holders_.push_back(who);
      return true;
    }
    void await_suspend(std::coroutine_handle<> handle) const {
      resource.waiting_.push_back({std::make_shared<Waiter>(Waiter{handle}), who});
    }
    void await_resume() const noexcept {}
  };
  struct Queued {
    std::shared_ptr<Waiter> waiter;
    std::string who;
  };
  Simulation& sim_;
  std::string name_;
  int capacity_;
  std::vector<std::string> holders_;
  std::deque<Queued> waiting_;
  double busy_ = 0, since_ = 0;
};

/// Places for `capacity` pieces: who puts waits while it is full, who gets waits while it is empty, first come first.
class Buffer {
 public:
  Buffer(Simulation& sim, std::size_t capacity) : sim_(sim), capacity_(capacity) {}
  auto put() { return Step{*this, true}; }
  auto get() { return Step{*this, false}; }
  [[nodiscard]] std::size_t count() const { return count_; }

 private:
  struct Step {
    Buffer& buffer;
    bool puts;
    [[nodiscard]] bool await_ready() const;
    void await_suspend(std::coroutine_handle<> handle) const;
    void await_resume() const noexcept {}
  };
  Simulation& sim_;
  std::size_t capacity_, count_ = 0;
  std::deque<std::shared_ptr<Waiter>> putters_, getters_;
};

/// Who waits for whom. A cycle among them never ends by itself.
struct Wait {
  std::string who, what;          ///< "arm", "a full container in holder"
  std::vector<std::string> whom;  ///< who could bring it; empty: nobody
};
/// The first cycle of waiting, as indices into `waits`; empty if there is none. Deterministic.
std::vector<std::size_t> waiting_cycle(const std::vector<Wait>& waits);

}  // namespace polypod::cell
