// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Studies of robot cells: what a study asks of a cell in the place of a machine.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "polypod/core/config.hpp"
#include "polypod/design/evaluate.hpp"

namespace polypod::design {

/// The part of a study file that names a cell: `cell`, `runs`, [[set]]. The cell is kept whole in Study::machine_toml,
/// with the texts of its machines. `kept`: that text, where it is there; no other file is read then. Errors: those of
/// cell files, OP145 (a key that says nothing of a cell).
Status read_cell(const config::Table& table, const std::string& name, const std::string& kept, Study& s);

/// Whether the cell has this number, whatever value it may take. Error: OP102.
Status cell_knows(const Study& s, const std::string& key, double value, const Place& place);

/// Whether the study may ask the cell for its goals and holds. Errors: OP107 (a figure that is none of this cell's),
/// OP145 (a goal that nothing can be divided by).
Status judge_cell_figures(const Study& s);

/// The number under a key; none where the file does not give it.
std::optional<double> cell_number(const Study& s, const std::string& key);

/// The cell with these values of the varied keys, as the text of a cell file that needs no other.
Result<std::string> cell_at(const Study& s, const std::vector<double>& varied);

/// What a candidate is worth; without `varied` the cell as it is. The order is that of cost: reach, bodies and guards
/// first; a cell that has a problem there is not simulated, and breaks the study like a hold. Then the cycle, in the
/// runs that the study asks for, with the seeds of the cell: all candidates meet the same random numbers. Items that
/// are missed are a problem, but where they are a goal or a hold. Deterministic; one thread. Errors: WS110.
Result<Evaluation> evaluate_cell(const Study& s, const std::vector<double>* varied, const EvaluateOptions& options);

}  // namespace polypod::design
