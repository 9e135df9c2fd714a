// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the program says of a command line and of errors.
#pragma once

#include <string>
#include <vector>

#include "command.hpp"

namespace polypod::app {

/// The whole text as one number of this range, whose unit the message names. Errors: AP115 with the option's name, the
/// text and the range.
Result<double> number_of(const std::string& text, const std::string& option, config::Range range,
                         const std::string& unit);
/// The same for whole numbers.
Result<int> count_of(const std::string& text, const std::string& option, config::Range range, const std::string& unit);

/// Whether the value of an option lies in its range. Errors: `id` with the option's name, the value, the range and its
/// unit.
Status in_range(const char* id, const std::string& option, double value, config::Range range,
                const std::string& unit = {});

/// One line on stderr; where JSON is not asked for, with the line of the file that the error is about.
void print_error(const Context& context, const Error& error);

/// The command line of this run as a shell reads it back, for the pages: `polypod map lola50 -o 'a b.html'`. Empty
/// before the program has kept it.
const std::string& command_line();
/// For the program, once: `words` begin with the name of the program, which is written as `polypod`.
void keep_command_line(const std::vector<std::string>& words);

/// A figure that shows 0 has no sign: "-0.000" becomes "0.000".
std::string unsigned_zero(std::string text);

}  // namespace polypod::app
