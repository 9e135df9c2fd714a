// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A family that stands outside Polypod: the struct and the functions of a user of the library, behind one machine.
#pragma once

#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/core/config.hpp"
#include "polypod/machine/common.hpp"

namespace polypod::machine {

class OwnQuestions;

/// A machine of a family that Polypod does not know: `own(m)` makes one of the user's struct, `add_family<M>()` lets
/// machine files name it (families/own/family.hpp).
struct Own {
  static constexpr std::string_view kFamily = "own";  ///< files give the name of the user's family
  /// A pose may be taken in any posture that keeps the limits.
  static constexpr bool kAnyPosture = true;

  std::string name;
  std::string description;
  std::string family;
  std::shared_ptr<const OwnQuestions> questions;
  std::vector<double> compliance;  ///< of each drive, rad/Nm or m/N
  Provenance provenance;

  /// Whether a family of this name was added.
  static bool reads(const std::string& family);
  /// The names of the families that were added.
  static std::vector<std::string> families();
  /// By the reader of the family that the table names, after `compliance_rad_per_Nm` (one number a joint; m/N for
  /// prismatic ones) and `provenance`. Errors: those of the reader, MA170 (as many compliances as joints).
  static Result<Own> from(const config::Table& table);
};

std::vector<Parameter> parameters(const Own& m);
std::vector<Parameter> settings(const Own& m);
std::string to_toml(const Own& m);
/// Errors: MA104 for families without `with_parameters`, and those of the family.
Result<Own> with_parameters(const Own& m, std::span<const double> p);
std::string family_of(const Own& m);

namespace own_detail {
using Reader = std::function<Result<Own>(const config::Table&)>;
void add_reader(std::string family, Reader reader);
}  // namespace own_detail

}  // namespace polypod::machine
