// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "busy_line.hpp"

#include <fmt/format.h>

#include <chrono>
#include <cstdio>

namespace polypod::app {

BusyLine::BusyLine(const Context& context, std::string what) {
  if (context.progress) drawing_ = std::thread([this, what = std::move(what)] { draw(what); });
}

void BusyLine::end() {
  if (!drawing_.joinable()) return;
  {
    const std::lock_guard lock(mutex_);
    ended_ = true;
  }
  ended_changes_.notify_one();
  drawing_.join();
}

void BusyLine::draw(const std::string& what) {
  constexpr std::chrono::milliseconds kQuiet{2000}, kBetween{500};
  const auto begin = std::chrono::steady_clock::now();
  std::unique_lock lock(mutex_);
  if (ended_changes_.wait_for(lock, kQuiet, [this] { return ended_; })) return;
  do {
    const auto passed = std::chrono::duration_cast<std::chrono::seconds>(std::chrono::steady_clock::now() - begin);
    fmt::print(stderr, "\r{}, {} s so far\x1b[K", what, passed.count());
    std::fflush(stderr);
  } while (!ended_changes_.wait_for(lock, kBetween, [this] { return ended_; }));
  fmt::print(stderr, "\r\x1b[K");
  std::fflush(stderr);
}

}  // namespace polypod::app
