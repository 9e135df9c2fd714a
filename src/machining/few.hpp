// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <utility>
#include <vector>

#include "polypod/machining/simulate.hpp"

namespace polypod::machining {

/// Of any number of points in a row at most so many, at equal distances: where they are too many, every other goes.
class Few {
 public:
  /// `most`: an even number.
  explicit Few(std::size_t most = 200) : most_(most) {}
  void add(const Sample& sample) {
    if (seen_++ % stride_ != 0) return;
    if (kept_.size() == most_) {
      for (std::size_t i = 0; 2 * i < most_; ++i) kept_[i] = kept_[2 * i];
      kept_.resize(most_ / 2);
      stride_ *= 2;  // most_ is even, so this sample is the next in the wider row
    }
    kept_.push_back(sample);
  }
  std::vector<Sample> take() { return std::move(kept_); }

 private:
  std::size_t most_;
  std::vector<Sample> kept_;
  std::size_t seen_ = 0, stride_ = 1;
};

}  // namespace polypod::machining
