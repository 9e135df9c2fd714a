// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The sequence of a cell for its PLC: a table of steps, the chart of its states, Structured Text (IEC 61131-3) and
// PLCopen XML with a sequential function chart.
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

/// From one state of the cell to another. Of two that leave one state the first counts where both conditions hold.
struct Transition {
  std::string from, to;
  std::string condition;  ///< an expression of Structured Text over the inputs of the program
  std::string words;
};
/// The chart of the cell's states; the first state is that after power-on.
struct StateChart {
  std::vector<std::string> states;
  std::vector<Transition> transitions;
};
StateChart state_chart(const Cell& cell);

/// A program of one state machine for the cell and one for each machine, with the interlocks: a frame for the PLC's
/// programmer, who binds the inputs and outputs that it declares. Names are made identifiers (letters, digits and _),
/// each once, also without regard to capitals.
std::string structured_text(const Cell& cell);

/// The same program as PLCopen XML (TC6 XML, version 2.01), to be imported into a programming system: the function
/// block `CellStates` is the chart of states as a sequential function chart, one step a state and one transition a
/// transition; the program calls it and has the rest as Structured Text. It holds no date of its making, so that the
/// same cell gives the same bytes; `creationDateTime`, which the format demands, is 1970-01-01.
std::string plcopen_xml(const Cell& cell);

}  // namespace polypod::cell
