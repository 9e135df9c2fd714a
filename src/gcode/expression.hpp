// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Reads one line of RS-274/NGC whose numbers are parameters and expressions.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/gcode/program.hpp"

namespace polypod::gcode {

/// The parameters of a running program.
class Parameters {
 public:
  Parameters() = default;
  Parameters(const Parameters&) = default;
  Parameters(Parameters&&) = default;
  Parameters& operator=(const Parameters&) = default;
  Parameters& operator=(Parameters&&) = default;
  virtual ~Parameters() = default;
  /// The value of `#index`, 1 <= index <= kLastParameter; an error text where it has none now.
  virtual tl::expected<double, std::string> numbered(int index) const = 0;
  /// The value of `#<name>` (lower case, without blanks); nothing where it is not defined.
  virtual tl::expected<std::optional<double>, std::string> named(const std::string& name) const = 0;
  /// Whether cutter radius compensation is on, under which LinuxCNC tells no position.
  [[nodiscard]] virtual bool compensates() const { return false; }
};

constexpr int kLastParameter = 5601;
/// Up to here parameters are the programs' own; those beyond tell the state of the machine.
constexpr int kLastOwnParameter = 5000;

/// What a line says once its expressions have values.
struct Line {
  struct Assignment {
    int index = 0;     ///< of a numbered parameter, or
    std::string name;  ///< of a named one
    double value = 0;
    int column = 0;
  };
  std::vector<Word> words;  ///< O words of `keyword` lines are not among them
  std::vector<Assignment> assignments;
  bool optional = false;
  bool percent = false;
  std::string label;              ///< of an O word: `100`, `name`
  std::string keyword;            ///< lower case: sub, call, if, ...; empty for a number alone
  std::vector<double> arguments;  ///< in brackets behind the keyword
  int label_column = 0;
};

/// The label and the keyword of a line that begins with an O word whose label needs no evaluation; nothing for other
/// lines. Cheap: loops and branches that are skipped are searched with it.
std::optional<std::pair<std::string, std::string>> o_word_of(std::string_view text);

/// Reads `text`. Assignments are listed, not made: they count from the next line on. Errors: GC100 to GC103, GC106,
/// GC107, GC160 a malformed expression, GC161 an expression without a value, GC162 a parameter that is not defined or
/// out of range, GC163 text behind an O word.
Result<Line> read_line(std::string_view text, const Parameters& parameters, const Place& place);

/// A message with its parameters (`#5`, `#<name>`) replaced by values, in the formats %d, %f and %.3f where they stand
/// before; ###### for what is not defined.
std::string expanded(std::string_view message, const Parameters& parameters);

}  // namespace polypod::gcode
