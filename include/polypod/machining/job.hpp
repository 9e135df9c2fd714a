// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A job: all that is needed besides the program to say what a machine will do with it.
#pragma once

#include <array>
#include <map>
#include <string>

#include "polypod/core/error.hpp"
#include "polypod/cutting/cutter.hpp"
#include "polypod/cutting/stock.hpp"
#include "polypod/gcode/interpreter.hpp"
#include "polypod/machine/any_machine.hpp"

namespace polypod::machining {

struct Job {
  std::string path;
  std::string machine_name;
  machine::AnyMachine machine;
  Pose X_MW;  ///< workpiece frame (that of G54) in the machine frame; turned about z_M only
  std::array<Vec3, 6> work_offsets{Vec3::Zero(), Vec3::Zero(), Vec3::Zero(),
                                   Vec3::Zero(), Vec3::Zero(), Vec3::Zero()};  ///< origins of G54..G59 in W, m
  cutting::Cutter cutter;                  ///< for every tool number that has none of its own
  std::map<int, cutting::Cutter> cutters;  ///< by T number
  cutting::Material material;
  cutting::Stock stock;
  double tolerance = 0;  ///< radius delta_t of the tube, m
  double step = 0;       ///< longest distance between evaluated points, m
  bool block_delete = false;

  [[nodiscard]] const cutting::Cutter& cutter_of(int tool) const {
    const auto it = cutters.find(tool);
    return it == cutters.end() ? cutter : it->second;
  }
  [[nodiscard]] gcode::InterpretOptions interpret_options() const {
    gcode::InterpretOptions options;
    options.work_offsets = work_offsets;
    options.block_delete = block_delete;
    return options;
  }
};

/// Reads a job file (docs/job-files.md); paths in it are relative to it. Errors: MC1xx and those of the parts.
Result<Job> read_job(const std::string& path);

}  // namespace polypod::machining
