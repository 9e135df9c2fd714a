// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <string>

#include "paths.hpp"
#include "polypod/core/files.hpp"
#include "polypod/machining/correct.hpp"

namespace polypod::testing {

struct Example {
  machining::Job job;
  gcode::Program program;
  gcode::Interpretation interpretation;
};

inline std::string example_path(const std::string& name, const std::string& file) {
  return test::source("examples/" + name + "/" + file);
}

template <class T>
T unwrap(Result<T> result) {
  if (!result) {
    ADD_FAILURE() << to_string(result.error());
    std::abort();
  }
  return std::move(*result);
}

inline Example load_example(const std::string& name) {
  Example e{unwrap(machining::read_job(example_path(name, "job.toml"))),
            unwrap(gcode::read(example_path(name, "program.ngc"))),
            {}};
  e.interpretation = unwrap(gcode::interpret(e.program, e.job.interpret_options()));
  return e;
}

/// The example's job with another program.
inline Example with_program(const std::string& job, const std::string& text) {
  Example e{unwrap(machining::read_job(example_path(job, "job.toml"))), unwrap(gcode::parse(text, "test.ngc")), {}};
  e.interpretation = unwrap(gcode::interpret(e.program, e.job.interpret_options()));
  return e;
}

inline machining::Prediction predict(const Example& e, const machining::PredictOptions& options = {}) {
  return unwrap(machining::predict(e.job, e.program, e.interpretation, options));
}

inline machining::Correction correct(const Example& e, const machining::CorrectOptions& options = {}) {
  return unwrap(machining::correct(e.job, e.program, e.interpretation, options));
}

/// The checks that every correction must pass, from the outside: what was read back is simulated by its own pass and
/// compared with the programmed path by a plain search for the nearest point, not by what the corrector reports.
inline void expect_in_tube(const Example& e, const machining::Correction& c) {
  EXPECT_TRUE(c.within_tolerance) << c.reason;
  EXPECT_LE(c.largest_distance, e.job.tolerance);
  cutting::Stock stock = e.job.stock;
  machining::PassOptions options;
  options.step = 0.4e-3;  // not the corrector's own step
  double worst = 0;
  std::size_t cutting_points = 0;
  const auto result =
      machining::run_pass(e.job, c.program, c.commanded, stock, options, [&](const machining::Sample& s) {
        if (!s.cutting) return;
        ++cutting_points;
        double nearest = 1;
        const int source = c.source[static_cast<std::size_t>(s.move)];
        for (int i = std::max(0, source - 1); i <= source + 1; ++i) {
          if (i >= static_cast<int>(e.interpretation.moves.size())) continue;
          const gcode::Move& move = e.interpretation.moves[static_cast<std::size_t>(i)];
          if (move.kind == gcode::MoveKind::rapid ||
              (i != source && !c.commanded[static_cast<std::size_t>(s.move)].transition)) {
            continue;
          }
          // What the thrust holds back on a plunge is cut when the tool comes to rest.
          const bool plunge = move.kind == gcode::MoveKind::line && move.direction(0).z() < -0.866;
          const int n = 4000;
          for (int k = 0; k <= n; ++k) {
            Vec3 off = s.bent() - move.point(move.length() * k / n);
            if (plunge) off -= move.direction(0) * std::min(0.0, move.direction(0).dot(off));
            nearest = std::min(nearest, off.norm());
          }
        }
        worst = std::max(worst, nearest);
      });
  ASSERT_TRUE(result) << to_string(result.error());
  EXPECT_GT(cutting_points, 50u);
  // Another step meets other cells of the stock: 3 um of force noise; the search's own spacing adds up to 1 um here.
  constexpr double kSlack = 4e-6;
  EXPECT_LE(worst, e.job.tolerance + kSlack);
}

/// A folder that goes with the test.
class Scratch {
 public:
  Scratch() {
    std::string name = std::filesystem::temp_directory_path() / "polypod-XXXXXX";
    path_ = ::mkdtemp(name.data());
  }
  ~Scratch() { std::filesystem::remove_all(path_); }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  [[nodiscard]] std::string file(const std::string& name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

}  // namespace polypod::testing
