// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A cell file as text that is changed and kept.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/cell/cell.hpp"

namespace polypod::cell {

/// The same cell as text that needs no other file: numbers replaced by the overrides, and the text of its machine file
/// under `model` of each [[machine]] in the place of `file` and `set`. Keys stand in alphabetical order, comments are
/// gone; what this gives is given back unchanged. `file`: where machines are looked for beside. Errors: those of TOML
/// files, of machine::load, and CE108 (an override). The cell itself is not judged.
Result<std::string> self_contained(std::string_view toml, const std::string& file,
                                   const std::vector<Override>& overrides = {});

/// A number of a cell: its key as `--set` takes it (`minutes`, `conveyor.A.speed_mm_per_s`, `task.fill.window_mm[1]`),
/// and the same as the file counts (`conveyor[1].speed_mm_per_s`).
struct CellNumber {
  std::string key, counted;
  double value = 0;
};
std::vector<CellNumber> numbers_of(std::string_view toml);

/// The number under a key, by name or as the file counts; none where the text does not give it.
std::optional<double> number_at(std::string_view toml, const std::string& key);

/// The key as the file counts: `conveyor.A.speed_mm_per_s` is `conveyor[1].speed_mm_per_s`. Two keys are of one number
/// where these are equal. A text that is no cell leaves the key as it is.
std::string counted_key(std::string_view toml, const std::string& key);

}  // namespace polypod::cell
