// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A line for work that does not know its share.
#pragma once

#include <condition_variable>
#include <mutex>
#include <string>
#include <thread>

#include "command.hpp"

namespace polypod::app {

/// Says on stderr, if it is a terminal, that work goes on and for how long, after two seconds; until it ends or is
/// destroyed. Nothing else is to be written meanwhile.
class BusyLine {
 public:
  BusyLine(const Context& context, std::string what);
  BusyLine(const BusyLine&) = delete;
  BusyLine& operator=(const BusyLine&) = delete;
  ~BusyLine() { end(); }
  void end();

 private:
  void draw(const std::string& what);

  std::mutex mutex_;
  std::condition_variable ended_changes_;
  bool ended_ = false;
  std::thread drawing_;
};

}  // namespace polypod::app
