// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The progress line of work that has stages of its own.
#pragma once

#include <chrono>
#include <functional>
#include <string>

#include "command.hpp"

namespace polypod::app {

/// One progress_line a stage: the next stage ends the line of the one before.
class StagesLine {
 public:
  explicit StagesLine(const Context& context) : context_(context) {}

  /// The share that is done of the stage `what`; false if the user pressed Ctrl-C.
  bool operator()(const char* what, double share) {
    if (stage_ != what) {
      end();
      stage_ = what;
      line_ = progress_line(context_, stage_, begin_);
    }
    return line_(share);
  }
  void end() {
    if (line_) line_(1);
  }

 private:
  const Context& context_;
  std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
  std::string stage_;
  std::function<bool(double)> line_;
};

}  // namespace polypod::app
