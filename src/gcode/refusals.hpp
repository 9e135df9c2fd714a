// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What is refused wherever it stands, and why.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "polypod/gcode/program.hpp"

namespace polypod::gcode {

struct Refusal {
  std::string_view id;
  std::string_view why;
  std::string_view hint;
};
/// Why a G code, times ten, that neither `interpret` nor the engine knows is refused.
Refusal refusal_of(int g);

/// A word of M19, M62 to M68 that is missing or that LinuxCNC does not take.
struct WrongArgument {
  const Word* word = nullptr;
  std::string what;
};
std::optional<WrongArgument> wrong_argument(const Block& block);

/// "M3 and M4 exclude each other in one block", or that one stands there twice.
std::string excluding(const std::string& one, const std::string& other);

}  // namespace polypod::gcode
