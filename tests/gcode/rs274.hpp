// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// LinuxCNC's interpreter as an oracle.
#pragma once

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "polypod/gcode/canon.hpp"

namespace polypod::gcode {

namespace fs = std::filesystem;

/// A folder of its own, which is also the home of rs274 (it keeps a memory-mapped tool table there).
class Scratch {
 public:
  Scratch() {
    std::string name = (fs::temp_directory_path() / "polypod_canon_XXXXXX").string();
    if (::mkdtemp(name.data()) != nullptr) path_ = name;
  }
  ~Scratch() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  [[nodiscard]] std::string operator/(const std::string& name) const { return (path_ / name).string(); }
  [[nodiscard]] std::string string() const { return path_.string(); }

 private:
  fs::path path_;
};

inline std::string slurp(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::stringstream all;
  all << in.rdbuf();
  return all.str();
}

struct Reference {
  bool accepted = false;
  std::string text;
  std::string errors;
};

/// What rs274 prints. The parameter file is copied, for rs274 writes it. A loop without end is cut off after 5 s of the
/// processor, far more than any program here takes.
inline Reference rs274(const Scratch& scratch, const std::string& program, const CanonOptions& options,
                       const std::string& folder = "") {
  const std::string parameters = scratch / "p.var";
  std::error_code ignored;
  fs::remove(parameters, ignored);
  if (options.parameters.empty()) {
    std::ofstream{parameters};
  } else {
    fs::copy_file(options.parameters, parameters, ignored);
  }
  const std::string command = fmt::format(
      "cd '{5}' && ulimit -t 5 && HOME='{0}' timeout 20 '{1}' {2} {3} -v '{0}/p.var' -g '{4}' >'{0}/out.txt' "
      "2>'{0}/err.txt' "
      "</dev/null",
      scratch.string(), POLYPOD_RS274, options.tool_table.empty() ? "" : "-t '" + options.tool_table + "'",
      options.block_delete ? "-b" : "", program, folder.empty() ? scratch.string() : folder);
  Reference reference;
  reference.accepted = std::system(command.c_str()) == 0;
  reference.text = slurp(scratch / "out.txt");
  reference.errors = slurp(scratch / "err.txt");
  return reference;
}

/// With POLYPOD_KEEP_FAILED=FILE in the environment, a program that differs is kept.
inline void keep_failed(bool failed, const std::string& text) {
  const char* file = std::getenv("POLYPOD_KEEP_FAILED");
  if (failed && file != nullptr) std::ofstream(file) << text;
}

inline std::vector<std::string> lines(const std::string& text) {
  std::vector<std::string> result;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) result.push_back(line);
  return result;
}

/// A line of canonical text: its words, and its numbers.
struct Call {
  std::string name;
  std::vector<double> numbers;
};

inline Call call_of(const std::string& line) {
  Call call;
  const std::size_t open = line.find('(');
  call.name = line.size() > 13 ? line.substr(13, open == std::string::npos ? open : open - 13) : line;
  if (open == std::string::npos || call.name == "COMMENT") {
    call.name = line.substr(std::min<std::size_t>(line.size(), 6));
    return call;
  }
  const char* at = line.c_str() + open + 1;
  for (char* end = nullptr;; at = end) {
    while (*at == ',' || *at == ' ') ++at;
    const double value = std::strtod(at, &end);
    if (end == at) break;
    call.numbers.push_back(value);
  }
  return call;
}

/// Where two canonical texts differ by more than the last printed digit, if they do. Beyond 100 units a coordinate may
/// be off by a millionth of what it has more: it is that of an entry arc that is nearly a line, and follows the
/// rounding of its program.
inline std::optional<std::string> difference(const std::string& ours, const std::string& theirs) {
  const auto a = lines(ours);
  const auto b = lines(theirs);
  for (std::size_t i = 0; i < std::max(a.size(), b.size()); ++i) {
    const std::string x = i < a.size() ? a[i] : "(nothing)";
    const std::string y = i < b.size() ? b[i] : "(nothing)";
    const Call p = call_of(x);
    const Call q = call_of(y);
    bool same = p.name == q.name && p.numbers.size() == q.numbers.size() && x.substr(0, 12) == y.substr(0, 12);
    for (std::size_t k = 0; same && k < p.numbers.size(); ++k) {
      const double tolerance = 1.01e-4 + 1e-6 * std::max(0.0, std::abs(q.numbers[k]) - 100);
      same = std::abs(p.numbers[k] - q.numbers[k]) <= tolerance;
    }
    if (!same) return fmt::format("line {}: {} instead of {}", i + 1, x, y);
  }
  return std::nullopt;
}

}  // namespace polypod::gcode
