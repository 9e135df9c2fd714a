// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The commands that work with LinuxCNC.
#pragma once

#include "command.hpp"

namespace polypod::app {

Command export_linuxcnc_command();
Command record_command();

}  // namespace polypod::app
