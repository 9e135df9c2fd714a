// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Canonical text of a program of short lines: lines a second of processor time, by Polypod and by LinuxCNC's rs274.
#include <benchmark/benchmark.h>
#include <fmt/format.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "polypod/gcode/canon.hpp"

namespace {

using namespace polypod;

constexpr int kLines = 100'000;

/// A folder with the program `long.ngc`, gone at the end.
class Folder {
 public:
  Folder() {
    std::filesystem::create_directories(path_);
    std::ofstream out(program());
    out << "G21 G90 G17 G94\nS12000 M3\nG0 X-60 Y-50 Z5\nG1 F1800\n";
    for (int k = 0; k < kLines; ++k) {
      const double x = 0.3 * (k % 300), y = 0.1 * (k / 300);
      out << fmt::format("G1 X{:.4f} Y{:.4f} Z{:.4f}\n", x, y + 0.5 * std::sin(0.3 * x), 0.3 * std::sin(0.4 * x));
    }
    out << "M2\n";
  }
  ~Folder() {
    std::error_code none;
    std::filesystem::remove_all(path_, none);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  [[nodiscard]] std::string program() const { return (path_ / "long.ngc").string(); }
  [[nodiscard]] std::string path() const { return path_.string(); }

 private:
  std::filesystem::path path_ = std::filesystem::temp_directory_path() / fmt::format("polypod-bench-{}", ::getpid());
};

double seconds(int who) {
  rusage usage{};
  getrusage(who, &usage);
  return static_cast<double>(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
         1e-6 * static_cast<double>(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
}

void canon(benchmark::State& state) {
  const Folder folder;
  for (auto _ : state) {
    const double before = seconds(RUSAGE_SELF);
    const auto program = gcode::read(folder.program());
    const auto text = gcode::long_canonical_text(*program);
    if (!text) state.SkipWithError(to_string(text.error()).c_str());
    state.SetIterationTime(seconds(RUSAGE_SELF) - before);
  }
  state.counters["lines_per_second"] =
      benchmark::Counter(kLines * static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
}
BENCHMARK(canon)->UseManualTime()->Unit(benchmark::kMillisecond);

/// A parameter file of its own, which it replaces; nothing to read from.
void rs274(benchmark::State& state) {
  const Folder folder;
  const std::string command = fmt::format(
      "cd {} && : > rs.var && timeout 60 rs274 -v rs.var -g long.ngc < /dev/null > rs.txt 2> rs.err", folder.path());
  for (auto _ : state) {
    const double before = seconds(RUSAGE_CHILDREN);
    if (std::system(command.c_str()) != 0) state.SkipWithError("rs274 did not run");
    state.SetIterationTime(seconds(RUSAGE_CHILDREN) - before);
  }
  state.counters["lines_per_second"] =
      benchmark::Counter(kLines * static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
}
BENCHMARK(rs274)->UseManualTime()->Unit(benchmark::kMillisecond);

}  // namespace
