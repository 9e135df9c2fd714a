// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Bytes as a short program in a small block, through the whole of `predict` and `correct`: figures are finite, and what
// is called within tolerance is so again when the written program is read and predicted with finer steps and judged
// without the bookkeeping of the correction.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <string>
#include <vector>

#include "memory_file.hpp"
#include "polypod/gcode/interpreter.hpp"
#include "polypod/machining/correct.hpp"
#include "require.hpp"

namespace {

using namespace polypod;
using fuzz::require;

/// Two distances that differ by less are the same, m: the cells of the stock move them by as much.
constexpr double kSame = 1e-6;

constexpr const char* kJob = R"(
machine = "lola50"
tolerance_um = {}
step_mm = 1
[workpiece]
origin_mm = [-50, -1335, 0]
[cutter]
diameter_mm = 4
teeth = 2
helix_deg = 30
length_mm = 12
[material]
Ktc_N_per_mm2 = 1027.78
Krc_N_per_mm2 = 182.03
Kac_N_per_mm2 = 64.5
Kte_N_per_mm = 13.65
Kre_N_per_mm = 27.95
Kae_N_per_mm = 2.21
[stock]
kind = "block"
min_mm = [0, 0, -4]
max_mm = [12, 12, 0]
)";

/// A program from bytes; every one is valid as G-code, arcs are half circles.
class Programs {
 public:
  Programs(const std::uint8_t* data, std::size_t size) : data_(data), size_(size) {}

  std::string text() {
    std::string out = "G21 G90 G17 G94\nS6000 M3\nG0 X-4 Y-4\nG0 Z5\nG1 Z-1 F300\n";
    constexpr int kMost = 12;
    for (int i = 0; i < kMost && at_ < size_; ++i) out += line();
    return out + "G0 Z5\nM2\n";
  }
  double tolerance_um() { return 20 + 2.0 * next(); }

 private:
  int next() { return at_ < size_ ? data_[at_++] : 0; }
  double within(double low, double high) { return std::round((low + (high - low) * next() / 255) * 100) / 100; }
  static std::string word(char letter, double value) { return " " + (letter + std::to_string(value)); }

  std::string to(double x, double y) {
    x_ = x;
    y_ = y;
    return word('X', x) + word('Y', y);
  }

  std::string line() {
    switch (next() % 8) {
      case 0:
        return "G0 Z5\nG0" + to(within(-4, 16), within(-4, 16)) + "\nG1" + word('Z', within(-3, 2)) + "\n";
      case 1:
        return "G1" + word('F', within(50, 1000)) + to(within(-4, 16), within(-4, 16)) + "\n";
      case 2:
        return "G1" + to(within(-4, 16), within(-4, 16)) + word('Z', within(-3, 2)) + "\n";
      case 3:
        return "G1" + word('Z', within(-3, 2)) + "\n";
      case 4:
      case 5: {
        const double i = within(-4, 4), j = within(-4, 4);
        if (i == 0 && j == 0) return "";
        const std::string centre = word('I', i) + word('J', j);
        return (next() % 2 == 0 ? "G2" : "G3") + to(x_ + 2 * i, y_ + 2 * j) + centre +
               (next() % 4 == 0 ? word('Z', within(-3, 1)) : "") + "\n";
      }
      case 6:
        return "S" + std::to_string(1000 + 40 * next()) + "\n";
      default:
        return "G1" + to(within(0, 12), y_) + "\n";
    }
  }

  const std::uint8_t* data_;
  std::size_t size_;
  std::size_t at_ = 0;
  double x_ = -4, y_ = -4;
};

void check_finite(const machining::Prediction& p) {
  require(std::isfinite(p.largest_distance) && p.largest_distance >= 0, "distances are finite");
  for (const machining::Spread& spread : {p.deflection, p.normal, p.vertical}) {
    require(std::isfinite(spread.min) && std::isfinite(spread.mean) && std::isfinite(spread.max) &&
                spread.min <= spread.max,
            "figures are finite and in order");
  }
  for (const machining::Sample& s : p.samples)
    require(s.bent().allFinite() && s.force.allFinite(), "samples are finite");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Programs programs(data, size);
  std::string text = kJob;
  text.replace(text.find("{}"), 2, std::to_string(programs.tolerance_um()));
  const fuzz::MemoryFile file(text);
  const auto job = machining::read_job(file.path());
  require(job.has_value(), "the job is one");
  const std::string ngc = programs.text();
  const auto program = gcode::parse(ngc, "fuzz.ngc");
  require(program.has_value(), "the program is one");
  const auto run = gcode::interpret(*program, job->interpret_options());
  require(run.has_value(), "the program is understood");

  machining::PredictOptions keep;
  keep.keep_samples = true;
  const auto predicted = machining::predict(*job, *program, *run, keep);
  if (!predicted) return fuzz::require_error(predicted.error()), 0;
  check_finite(*predicted);

  const auto corrected = machining::correct(*job, *program, *run);
  if (!corrected) return fuzz::require_error(corrected.error()), 0;
  check_finite(corrected->before);
  check_finite(corrected->after);
  require(corrected->largest_distance <= corrected->before.largest_distance + kSame, "never worse");
  if (!corrected->within_tolerance) {
    require(!corrected->reason.empty(), "a no has its reason");
    return 0;
  }
  require(corrected->largest_distance <= job->tolerance, "within tolerance by its own figures");
  const auto again = gcode::parse(corrected->text(), "again.ngc");
  require(again.has_value(), "a corrected program is read back");
  const auto again_run = gcode::interpret(*again, job->interpret_options());
  require(again_run.has_value(), "a corrected program is understood");
  keep.step = job->step / 4;
  keep.again = true;
  const auto fine = machining::predict(*job, *again, *again_run, keep);
  require(fine.has_value(), "a corrected program is predicted");
  return 0;
}
