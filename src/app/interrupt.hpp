// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace polypod::app {

/// From now on Ctrl-C sets a flag that long work looks at; a second Ctrl-C ends the program at once.
void catch_interrupts();
bool interrupted();

}  // namespace polypod::app
