// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The pictures and files that `workspace` writes.
#pragma once

#include "command.hpp"
#include "polypod/workspace/volume.hpp"

namespace polypod::app {

struct WorkspaceFiles {
  std::string stl, vtp, vti, report;
  int resolution = 0;  ///< 0: 64

  /// Errors: AP107 for a resolution of files that are not asked for.
  [[nodiscard]] Status refuse_unused(const Context& context) const;
  void declare(Arguments& arguments);
  /// Asked before the long work. Errors: AP130, those of check_files.
  [[nodiscard]] Status check(const std::string& machine_file, const Context& context) const;
  /// Makes all files before it writes the first, so that an interrupted run leaves none. `v` is the volume for the same
  /// options.
  [[nodiscard]] Status write(const machine::AnyMachine& m, const workspace::Options& options,
                             const workspace::Volume& v, const std::string& machine_name,
                             const std::vector<std::string>& sets, const Context& context) const;
};

}  // namespace polypod::app
