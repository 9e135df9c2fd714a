// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The pictures and files that `errors` and `dexterity` write.
#pragma once

#include <optional>

#include "polypod/pages/quality.hpp"
#include "survey_options.hpp"

namespace polypod::app {

/// What the files are about.
struct QualityWork {
  const machine::AnyMachine& machine;
  const quality::SurveyOptions& options;
  pages::QualityQuestion question;
  pages::QualityFields fields;
  pages::QualityPageOptions page;  ///< all but version, region and below
};

struct QualityFiles {
  std::string report, csv, vti, stl, svg, plane, at, below;
  pages::QualityValue value = pages::QualityValue::condition;  ///< what --below, --stl and --svg are about

  void declare(Arguments& arguments);
  [[nodiscard]] bool any() const;
  /// Asked before the long work; `at_pose`: the command looks at one pose. Errors: AP170 to AP174, WS107 (surfaces and
  /// fields of a task without x, y, z), those of check_files.
  [[nodiscard]] Status check(const machine::AnyMachine& machine, bool at_pose, const std::string& machine_file,
                             bool json) const;
  /// Makes all files before it writes the first.
  [[nodiscard]] Status write(const QualityWork& work) const;
  /// "wrote F" for each, as text.
  void print() const;

 private:
  [[nodiscard]] std::vector<const std::string*> paths() const;
  /// Of --plane and --at: the axis, and where on it, m or rad.
  [[nodiscard]] Result<std::pair<int, double>> section(const machine::AnyMachine& machine) const;
  [[nodiscard]] Result<std::optional<double>> threshold() const;
};

/// A --resolution that was given holds for all pictures of the page, too.
void set_resolution(pages::QualityPageOptions& page, const SurveyArguments& where, const Context& context);

}  // namespace polypod::app
