// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A machine of any family, machine files and the catalogue.
#pragma once

#include <span>
#include <string>
#include <variant>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/machine/families.hpp"

namespace polypod::machine {

/// A machine of any family. Analyses are templates on a family; std::visit picks the instance once, outside the loops.
/// A family becomes one only where that is written out: a question that a family does not answer is then an error of
/// the compiler, and never the same question asked of AnyMachine again.
class AnyMachine : public Families::Variant {
 public:
  AnyMachine() = default;
  template <class F>
  requires(Families::holds<F>) explicit AnyMachine(F family) : Families::Variant(std::move(family)) {}
};

/// `key = value` of `--set`, as text: `tool.length_mm=120`.
struct Override {
  std::string key;
  std::string value;
};

/// A catalogue entry: its name and its file's text, compiled into the library.
struct CatalogueEntry {
  std::string_view name;
  std::string_view toml;
};
const std::vector<CatalogueEntry>& catalogue();

/// The key under which a parameter is shown and set: with its unit, as in a machine file: "base.joint[3].x_mm".
std::string key_of(const Parameter& parameter);

/// A machine from a file or, if there is no such file, from the catalogue, with overrides applied before it is checked.
/// Keys are those of the file (dots go into tables, [i] into arrays from 1) and those of `settings` and
/// kinematics::parameters with their units (key_of); single parameters are changed in the machine that all other keys
/// give.
/// Errors: MA100 (no such machine), MA101 (unknown family), MA102 (unknown key of an override), MA103 (not a number),
/// and those of the family's reader.
Result<AnyMachine> load(const std::string& name_or_path, const std::vector<Override>& overrides = {});

/// The same from text.
Result<AnyMachine> from_text(std::string_view toml, const std::string& file_name,
                             const std::vector<Override>& overrides = {});

/// What a designer changes, as keys of the machine file without their unit; empty for families without such keys.
std::vector<Parameter> settings(const AnyMachine& machine);

/// The machine with one figure changed: `key` as key_of gives it, of settings or parameters; `value` in its unit.
/// Errors: those of from_text.
Result<AnyMachine> with_value(const AnyMachine& machine, const std::string& key, double value);

/// The machine with other values p of kinematics::parameters(machine), SI. Errors: MA104 for a family that cannot take
/// them, MA105 for another count of values, and those of the family's reader.
Result<AnyMachine> with_parameters(const AnyMachine& machine, std::span<const double> p);

std::string to_toml(const AnyMachine& machine);
std::string name_of(const AnyMachine& machine);
std::string family_of(const AnyMachine& machine);
std::string description_of(const AnyMachine& machine);
const Provenance& provenance_of(const AnyMachine& machine);
/// Adds to where the numbers come from, or takes its place.
void note(AnyMachine& machine, const std::string& key, const std::string& text);

}  // namespace polypod::machine
