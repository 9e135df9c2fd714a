// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the words of the language are: modal groups, and what is not carried out.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <string_view>

#include "m_codes.hpp"
#include "polypod/gcode/interpreter.hpp"
#include "polypod/gcode/program.hpp"
#include "polypod/gcode/writer.hpp"
#include "refusals.hpp"
#include "text.hpp"

namespace polypod::gcode {

inline constexpr double kMmPerInch = 25.4;

/// The number of a G or M word times ten; -1 where it is no code.
int code_of(const Word& word);
bool is_cycle(int g);
/// Words that take axis words for something other than a motion of their mode.
bool is_zero_group(int g);
bool is_motion(int g);
/// Modal group of a G code times ten: 0 for codes that are not carried out, 30 for those that are passed through.
int group_of(int g);

/// The first and second axis of a plane and its normal.
std::array<std::size_t, 3> axes_of(Plane plane);

/// What to do about a letter without a number at `at` of the line, which may begin a word of several letters.
std::string missing_number_hint(std::string_view line, std::size_t at);

template <std::size_t N>
void scale(std::array<double, N>& values, double factor) {
  for (std::size_t k = 0; k < 3; ++k) values[k] *= factor;
}

}  // namespace polypod::gcode
