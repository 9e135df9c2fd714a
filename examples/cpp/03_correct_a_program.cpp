// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Shows: a job and a program are read, the program is corrected for the deflection of the tool under the cutting
// forces, and the new program is written. `polypod correct PROGRAM --job JOB -o OUTPUT` does the same. Build, with
// Polypod installed under PREFIX:
//   cmake -S examples/cpp -B build/examples -DCMAKE_PREFIX_PATH=PREFIX && cmake --build build/examples
// Run: 03_correct_a_program examples/slavkovic_groove/job.toml examples/slavkovic_groove/program.ngc corrected.ngc
#include <cstdio>

#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"
#include "polypod/gcode/interpreter.hpp"
#include "polypod/gcode/program.hpp"
#include "polypod/machining/correct.hpp"
#include "polypod/machining/job.hpp"

namespace {
int stop(const polypod::Error& error) {
  std::fprintf(stderr, "%s\n", to_string(error).c_str());
  return 1;
}
}  // namespace

int main(int argc, char** argv) {
  using namespace polypod;
  if (argc != 4) {
    std::fprintf(stderr, "usage: 03_correct_a_program JOB PROGRAM OUTPUT\n");
    return 1;
  }
  // The job names the machine, where the workpiece lies, cutter, material, stock and tolerance.
  const auto job = machining::read_job(argv[1]);
  if (!job) return stop(job.error());
  const auto program = gcode::read(argv[2]);
  if (!program) return stop(program.error());
  const auto moves = gcode::interpret(*program, job->interpret_options());
  if (!moves) return stop(moves.error());

  const auto correction = machining::correct(*job, *program, *moves);
  if (!correction) return stop(correction.error());
  std::printf("largest distance of the deflected tool from the programmed path:\n");
  std::printf("  before %.1f um\n  after  %.1f um\n", units::to_um(correction->largest_before),
              units::to_um(correction->largest_after));
  std::printf("%zu lines became %zu\n", correction->lines_in, correction->lines_out);

  // A tolerance that cannot be met is an answer and no error.
  if (!correction->within_tolerance) {
    std::fprintf(stderr, "the tool does not stay within the tolerance: %s\n", correction->reason.c_str());
    return 1;
  }
  // The file appears whole or not at all.
  if (const auto written = files::write_whole(argv[3], correction->text()); !written) return stop(written.error());
  std::printf("wrote %s\n", argv[3]);
  return 0;
}
