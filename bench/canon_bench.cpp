// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Canonical moves of a long program: `polypod canon` and LinuxCNC's rs274 as processes, one after the other, on the
// same file. The time is that of the processor, user and system, so that other work on the machine counts little; the
// aim is three times the rate of rs274.
#include <benchmark/benchmark.h>
#include <fmt/format.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

namespace {

namespace fs = std::filesystem;

/// A folder with a program of `lines` short lines, which is also the home of rs274 (it writes a parameter file and a
/// tool table there).
class Folder {
 public:
  explicit Folder(int lines) {
    std::string name = (fs::temp_directory_path() / "polypod_canon_bench_XXXXXX").string();
    if (::mkdtemp(name.data()) != nullptr) path_ = name;
    std::ofstream out(path_ / "long.ngc");
    out << "G21 G90 G17 G94\nT1 M6\nS12000 M3\nG0 X0 Y0 Z5\nG1 Z0 F1800\n";
    for (int i = 0; i < lines; ++i) {
      const double t = 1e-3 * i;
      out << fmt::format("G1 X{:.4f} Y{:.4f} Z{:.4f}\n", 40 * std::sin(t), 40 * std::cos(1.3 * t), -std::sin(9 * t));
    }
    out << "G0 Z5\nM2\n";
  }
  ~Folder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  [[nodiscard]] std::string file(const char* name) const { return (path_ / name).string(); }

 private:
  fs::path path_;
};

/// Seconds of processor time that children took up to now.
double children_time() {
  rusage used{};
  ::getrusage(RUSAGE_CHILDREN, &used);
  const auto seconds = [](const timeval& t) { return static_cast<double>(t.tv_sec) + 1e-6 * double(t.tv_usec); };
  return seconds(used.ru_utime) + seconds(used.ru_stime);
}

void run(benchmark::State& state, const std::string& program, const std::string& options) {
  const int lines = static_cast<int>(state.range(0));
  const Folder folder(lines);
  const std::string home = folder.file("");
  const std::string parameters = folder.file("p.var");
  const std::string command =
      fmt::format("cd '{0}' && HOME='{0}' '{1}' {2} '{3}' >'{0}/out.txt' 2>'{0}/err.txt' </dev/null", home, program,
                  fmt::format(fmt::runtime(options), parameters), folder.file("long.ngc"));
  for (auto _ : state) {
    std::ofstream{parameters};  // anew: rs274 writes it
    const double before = children_time();
    const int status = std::system(command.c_str());
    state.SetIterationTime(children_time() - before);
    if (status != 0) state.SkipWithError("it refuses the program");
  }
  std::ifstream text(folder.file("out.txt"));
  std::size_t moves = 0;
  for (std::string line; std::getline(text, line);) moves += line.find("STRAIGHT_FEED") != std::string::npos ? 1 : 0;
  if (moves < static_cast<std::size_t>(lines)) state.SkipWithError("it does not print every move");
  state.counters["lines_per_second"] = benchmark::Counter(lines, benchmark::Counter::kIsIterationInvariantRate);
}

void canon_polypod(benchmark::State& state) {
  run(state, POLYPOD_PROGRAM, "canon");
}
void canon_rs274(benchmark::State& state) {
  run(state, POLYPOD_RS274, "-v '{}' -g");
}
BENCHMARK(canon_polypod)->Arg(100000)->UseManualTime()->Unit(benchmark::kMillisecond);
BENCHMARK(canon_rs274)->Arg(100000)->UseManualTime()->Unit(benchmark::kMillisecond);

}  // namespace
