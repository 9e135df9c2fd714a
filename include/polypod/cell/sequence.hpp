// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The sequence of a cell for its PLC: a table of steps and Structured Text (IEC 61131-3).
#pragma once

#include <string>
#include <vector>

#include "polypod/cell/cell.hpp"

namespace polypod::cell {

struct SequenceRow {
  std::string state, step, condition, action, next;
};
/// States of the cell and the tasks in each, in the order of their priority.
std::vector<SequenceRow> sequence(const Cell& cell);

/// A program of one state machine for the cell and one for each machine, with the interlocks: a frame for the PLC's
/// programmer, who binds the inputs and outputs that it declares. Names are made identifiers (letters, digits and _).
std::string structured_text(const Cell& cell);

}  // namespace polypod::cell
