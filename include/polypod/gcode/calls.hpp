// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Which files a program runs beside its own.
#pragma once

#include <string>
#include <vector>

namespace polypod::gcode {

/// The files beside a program that it may call, with O words or M98, themselves or through others: NAME.ngc for
/// o<name>, 100.ngc for o100 and M98 P100. Whether a call is ever run is not asked. Of a file that cannot be read
/// nothing is said. Cost: linear in the bytes of all of them.
std::vector<std::string> files_called(const std::string& program);

}  // namespace polypod::gcode
