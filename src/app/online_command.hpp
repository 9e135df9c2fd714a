// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "command.hpp"

namespace polypod::app {

Command online_command();

}  // namespace polypod::app
