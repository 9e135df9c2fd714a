// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The plain program as text.
#pragma once

#include <string>

#include "polypod/gcode/program.hpp"
#include "polypod/gcode/unroll.hpp"

namespace polypod::gcode {

/// What `unroll` writes; an error as its text.
inline std::string plain(const std::string& text, const UnrollOptions& options = {}) {
  const auto program = parse(text, "part.ngc");
  if (!program) return to_string(program.error());
  const auto unrolled = unroll(*program, options);
  return unrolled ? to_text(unrolled->program) : to_string(unrolled.error());
}

}  // namespace polypod::gcode
