// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The program of a cell for its PLC, before it is written as text or as XML.
#pragma once

#include <map>
#include <set>
#include <string>
#include <tuple>
#include <vector>

#include "polypod/cell/sequence.hpp"

namespace polypod::cell {

/// Names as identifiers of IEC 61131-3: letters, digits and _, no word of the language, each once without regard to
/// capitals.
class Identifiers {
 public:
  Identifiers();
  /// The identifier of a name with what stands before and behind it; the same for the same three.
  std::string of(const std::string& prefix, const std::string& name, const std::string& suffix);

 private:
  std::map<std::tuple<std::string, std::string, std::string>, std::string> given_;
  std::set<std::string> taken_;  ///< in small letters
};

/// Text that may stand in a comment of Structured Text.
std::string comment_text(const std::string& text);

/// When a task can be done, in words.
std::string condition_of(const Cell& cell, const Task& task);

struct PlcVariable {
  enum class Section { input, output, local } section = Section::local;
  std::string name, type, initial, comment;
};
struct PlcProgram {
  std::string name;
  std::vector<PlcVariable> variables;
  std::vector<std::string> before;  ///< statements ahead of the chart of states
  std::vector<std::string> after;   ///< and behind it
};
/// `in_state` gives the expression that is TRUE in a state.
PlcProgram plc_program(const Cell& cell, std::string (*in_state)(const std::string& state));

}  // namespace polypod::cell
