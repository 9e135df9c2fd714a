// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cell/events.hpp"

#include <algorithm>
#include <utility>

namespace polypod::cell {

Simulation::~Simulation() {
  for (const std::coroutine_handle<> frame : frames_) frame.destroy();
}

void Simulation::plan(double time, std::shared_ptr<Waiter> waiter) {
  calendar_.push({time, planned_++, std::move(waiter)});
}

void Simulation::start(Process process) {
  const std::coroutine_handle<> handle = process.release();
  frames_.push_back(handle);
  plan(now_, std::make_shared<Waiter>(Waiter{handle}));
}

void Simulation::run(double until) {
  while (!calendar_.empty() && calendar_.top().time <= until) {
    const Entry entry = calendar_.top();
    calendar_.pop();
    if (entry.waiter->woken) continue;
    entry.waiter->woken = true;
    now_ = last_ = entry.time;
    ++events_;
    entry.waiter->handle.resume();
  }
  // What was woken otherwise is no event to come.
  while (!calendar_.empty() && calendar_.top().waiter->woken) calendar_.pop();
  now_ = std::max(now_, until);
}

void Signal::notify() {
  std::vector<std::shared_ptr<Waiter>> woken;
  woken.swap(waiters_);
  for (const std::shared_ptr<Waiter>& waiter : woken) {
    if (waiter->woken) continue;
    // A new entry takes the place of the planned one, so that who is woken now comes after what is planned for now.
    waiter->woken = true;
    waiter->signalled = true;
    sim_.plan(sim_.now(), std::make_shared<Waiter>(Waiter{waiter->handle}));
  }
}

void Resource::give(const std::string& who) {
  account();
  const auto at = std::find(holders_.begin(), holders_.end(), who);
  if (at != holders_.end()) holders_.erase(at);
  if (waiting_.empty() || !is_free()) return;
  const Queued next = waiting_.front();
  waiting_.pop_front();
  holders_.push_back(next.who);
  sim_.plan(sim_.now(), next.waiter);
}

bool Buffer::Step::await_ready() const {
  const auto wake = [&](std::deque<std::shared_ptr<Waiter>>& waiting) {
    buffer.sim_.plan(buffer.sim_.now(), waiting.front());
    waiting.pop_front();
  };
  if (puts) {
    if (!buffer.getters_.empty()) {  // straight on to who waits, also where there is no place at all
      wake(buffer.getters_);
      return true;
    }
    if (buffer.count_ >= buffer.capacity_) return false;
    ++buffer.count_;
    return true;
  }
  if (buffer.count_ == 0 && buffer.putters_.empty()) return false;
  if (buffer.putters_.empty())
    --buffer.count_;
  else
    wake(buffer.putters_);  // its piece takes the place that becomes free
  return true;
}

void Buffer::Step::await_suspend(std::coroutine_handle<> handle) const {
  (puts ? buffer.putters_ : buffer.getters_).push_back(std::make_shared<Waiter>(Waiter{handle}));
}

std::vector<std::size_t> waiting_cycle(const std::vector<Wait>& waits) {
  enum class Mark { fresh, open, closed };
  std::vector<Mark> mark(waits.size(), Mark::fresh);
  std::vector<std::size_t> path, cycle;
  const auto visit = [&](const auto& self, std::size_t at) -> bool {
    mark[at] = Mark::open;
    path.push_back(at);
    for (const std::string& whom : waits[at].whom) {
      for (std::size_t next = 0; next < waits.size(); ++next) {
        if (waits[next].who != whom) continue;
        if (mark[next] == Mark::open) {
          cycle.assign(std::find(path.begin(), path.end(), next), path.end());
          return true;
        }
        if (mark[next] == Mark::fresh && self(self, next)) return true;
      }
    }
    path.pop_back();
    mark[at] = Mark::closed;
    return false;
  };
  for (std::size_t start = 0; start < waits.size(); ++start)
    if (mark[start] == Mark::fresh && visit(visit, start)) return cycle;
  return {};
}

}  // namespace polypod::cell
