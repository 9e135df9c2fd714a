// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "polypod/core/files.hpp"
#include "polypod/machining/correct.hpp"

namespace polypod::testing {

struct Example {
  machining::Job job;
  gcode::Program program;
  gcode::Interpretation interpretation;
};

inline std::string example_path(const std::string& name, const std::string& file) {
  return std::string(POLYPOD_SOURCE_DIR) + "/examples/" + name + "/" + file;
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
