// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Programs with many lines take little more memory than short ones.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <string>

#include "examples.hpp"
#include "polypod/gcode/canon.hpp"
#include "polypod/machining/check.hpp"
#include "polypod/machining/predict.hpp"

namespace polypod {
namespace {

/// Bytes that the process holds in memory.
std::size_t resident() {
  std::ifstream statm("/proc/self/statm");
  std::size_t total = 0, held = 0;
  statm >> total >> held;
  return held * static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
}

/// `lines` lines of 0.1 mm along the groove of the example, back and forth a little deeper each time, with Z.
std::string many_lines(int lines) {
  std::string text = "G21 G90 G17 G94\nT1 M6\nS12000 M3\nG0 X-29 Y0 Z5\nG1 Z0 F1800\n";
  constexpr int kOneWay = 580;
  for (int i = 0; i < lines; ++i) {
    const int way = i / kOneWay, k = i % kOneWay;
    const double x = -29 + 0.1 * (way % 2 == 0 ? k + 1 : kOneWay - k - 1);
    text += fmt::format("G1 X{:.3f} Y{:.3f} Z{:.4f}\n", x, 2 * std::sin(0.2 * x + 0.1 * way),
                        -0.01 * way + 0.002 * std::sin(x));
  }
  return text + "G0 Z50\nM2\n";
}

/// The most memory held while `work(progress)` runs, above what was held before.
template <class Work>
std::size_t most_held(Work&& work) {
  const std::size_t before = resident();
  std::size_t most = before;
  work([&] {
    most = std::max(most, resident());
    return true;
  });
  most = std::max(most, resident());
  return most - before;
}

// A line took 0.5 kB (canon) to 0.9 kB (predict) when everything was held: 95 MB and more for what is added here.
constexpr int kShort = 10'000, kLong = 200'000;
constexpr std::size_t kMoreAtMost = 50'000'000;  // bytes, with what long rows may hold (LongBytes::kHeld)

TEST(LongPrograms, CanonHoldsLittleOfThem) {
  const auto held = [](int lines) {
    return most_held([&](const auto& look) {
      const gcode::Program program = *gcode::parse(many_lines(lines), "long.ngc");
      look();
      const auto text = gcode::long_canonical_text(program);
      ASSERT_TRUE(text.has_value());
      EXPECT_GT(text->size(), std::size_t{60} * static_cast<std::size_t>(lines));
      look();
    });
  };
  const std::size_t few = held(kShort);
  EXPECT_LT(held(kLong), few + kMoreAtMost);
}

TEST(LongPrograms, CheckAndPredictHoldLittleOfThem) {
  const auto held = [](int lines) {
    const auto e = testing::with_program("slavkovic_groove", many_lines(lines));
    return most_held([&](const auto& look) {
      machining::CheckOptions check;
      check.progress = [&](double) { return look(); };
      const auto checked = machining::check(e.job.machine, e.job.X_MW, e.program, e.interpretation, check);
      ASSERT_TRUE(checked.has_value());
      EXPECT_TRUE(checked->ok);
      machining::PredictOptions predict;
      predict.progress = check.progress;
      const auto predicted = machining::predict(e.job, e.program, e.interpretation, predict);
      ASSERT_TRUE(predicted.has_value()) << to_string(predicted.error());
      EXPECT_GT(predicted->moves.size(), static_cast<std::size_t>(lines / 2));
    });
  };
  const std::size_t few = held(kShort);
  EXPECT_LT(held(kLong), few + kMoreAtMost);
}

}  // namespace
}  // namespace polypod
